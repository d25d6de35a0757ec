# SPDX-License-Identifier: Apache-2.0
"""The program that runs on the robot: ur_rtde's protocol for what the driver uses, and a check of every step.

ur_rtde's own script sends the arm to the target that it was given last, wherever the arm has got to in the meantime:
after a safety stop, unlock and Play the arm jumps. This one sends it nowhere but near where it is on its way (as UR's
own driver does: `targetWithinLimits` of its external_control.urscript), and from rest only to where it stands; a
command that it does not know ends it. So does a TCP that somebody else changes: targets on their way are poses of the
one before, and the network may hold many of them. Registers, commands and handshake are those of ur_rtde 1.6.5 (MIT
licence).
"""

import os
from functools import cache

from seed_driver.robot.link import LinkError

MOVING = 0.1  # [rad] of any joint from a moving arm's own target; a usual lag is 0.04
AT_REST = 0.0005  # [rad] from a resting arm's: half a millimetre; the first commands of a motion are closer
REST = 0.00001  # [rad/s] of all joints together
SAME_TCP = 0.0001  # [m], [rad] of any of its numbers
BRAKE = 10.0  # [m/s^2] for a TCP that has changed; ur_rtde's for the end of servoing

_TEXT = """def rtde_control():
  # seed_driver
  # float register offset @offset@
  global step_moving = @moving@
  global step_at_rest = @at_rest@
  global servo_target = [0, 0, 0, 0, 0, 0]
  global servo_time = 0.002
  global servo_lookahead_time = 0.1
  global servo_gain = 300
  global servo_thrd = 0
  global is_servoing = 0
  global poses_of = get_tcp_offset()

  def number(index):
    return read_input_float_register(@offset@ + index)
  end

  def answer(value):
    write_output_integer_register(@offset@, value)
  end

  def is_near(q):
    # a joint that is not a number is near nowhere
    local here = get_target_joint_positions()
    local most = step_moving
    if norm(get_target_joint_speeds()) < @rest@:
      most = step_at_rest
    end
    local i = 0
    while i < 6:
      if not (norm(q[i] - here[i]) <= most):
        return False
      end
      i = i + 1
    end
    return True
  end

  def tcp_is_another():
    local tcp = get_tcp_offset()
    local i = 0
    while i < 6:
      if not (norm(tcp[i] - poses_of[i]) <= @same_tcp@):
        return True
      end
      i = i + 1
    end
    return False
  end

  thread servo_thread():
    while (True):
      enter_critical
      q = servo_target
      dt = servo_time
      lh_time = servo_lookahead_time
      g = servo_gain
      exit_critical
      if not is_near(q):
        # as after a stop: stay
        q = get_target_joint_positions()
      end
      servoj(q, t=dt, lookahead_time=lh_time, gain=g)
    end
  end

  def servo(q):
    if is_near(q):
      enter_critical
      servo_target = q
      servo_time = number(8)
      servo_lookahead_time = number(9)
      servo_gain = number(10)
      exit_critical
      if is_servoing == 0:
        is_servoing = 1
        global servo_thrd = run servo_thread()
      end
    end
  end

  def servo_stop(deceleration):
    if is_servoing == 1:
      enter_critical
      is_servoing = 0
      kill servo_thrd
      exit_critical
    end
    stopl(deceleration)
  end

  def process(cmd):
    if cmd == 8:
      zero_ftsensor()
    elif cmd == 16:
      servo_stop(number(0))
    elif cmd == 17:
      set_payload(number(0), [number(1), number(2), number(3)])
@inertia@
    elif cmd == 29:
      set_tcp(p[number(0), number(1), number(2), number(3), number(4), number(5)])
      global poses_of = get_tcp_offset()
    elif cmd == 35:
      rtde_set_watchdog("input_int_register_@offset@", number(0), "stop")
    elif cmd == 40:
      tcp = get_tcp_offset()
      i = 0
      while i < 6:
        write_output_float_register(@offset@ + i, tcp[i])
        i = i + 1
      end
    elif cmd == 52:
      @freedrive@
    elif cmd == 53:
      end_@freedrive@
    else:
      textmsg("seed_driver: ends, for it does not know the command ", cmd)
      return False
    end
    answer(2)
    return True
  end

  keep_running = True
  executing = False
  answer(1)
  while keep_running:
    cmd = read_input_integer_register(@offset@)
    if cmd == 29:
      # it may be shown a cycle later
      global poses_of = get_tcp_offset()
    end
    if tcp_is_another():
      # the targets that come are poses of the one before
      textmsg("seed_driver: ends, for the TCP has changed")
      if is_servoing == 1:
        servo_stop(@brake@)
      end
      keep_running = False
    elif cmd == 24:
      servo(get_inverse_kin(p[number(0), number(1), number(2), number(3), number(4), number(5)]))
      answer(1)
    elif cmd == 0:
      executing = False
      answer(1)
    elif cmd == 255:
      keep_running = False
    elif not executing:
      executing = True
      keep_running = process(cmd)
    end
    sync()
  end
end
"""
_INERTIA = """    elif cmd == 65:
      inertia = [number(4), number(5), number(6), number(7), number(8), number(9)]
      set_target_payload(number(0), [number(1), number(2), number(3)], inertia)"""


def program(version: tuple[int, ...], offset: int) -> str:
    """The program's text for a controller of this version, with registers from `offset` on."""
    new = version[:2] >= (5, 10)
    words = {
        "offset": offset,
        "moving": MOVING,
        "at_rest": AT_REST,
        "rest": f"{REST:.5f}",
        "same_tcp": f"{SAME_TCP:.4f}",
        "brake": BRAKE,
        "freedrive": "freedrive_mode()" if new else "teach_mode()",
        "inertia": _INERTIA if new else "",
    }
    text = _TEXT
    for name, word in words.items():
        text = text.replace(f"@{name}@", str(word))
    return "\n".join(line for line in text.splitlines() if line) + "\n"


@cache
def program_file(text: str) -> str:
    """Path of a file with the program's text, which ur_rtde reads whenever it sends it.

    It lives in memory, one for each text, and as long as this process. Raises LinkError: there is no room for it.
    """
    fd, data = os.memfd_create("seed_driver_program"), text.encode()
    if os.write(fd, data) != len(data):
        raise LinkError("no memory for the robot's program")
    return f"/proc/self/fd/{fd}"
