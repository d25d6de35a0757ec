# SPDX-License-Identifier: Apache-2.0
"""Low-passes of what the images say, each with the time constant of its purpose."""

from collections import deque
from math import inf

import numpy as np

from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import AxisFlags
from seed_control.wrench.estimate import ROTATION_DEVIATION, Measurement, low_pass_share
from seed_core.spatial import Array, Wrench, length, make_pose, rpy_from_rotation, so3_exp, so3_log

_NO_TURN = 1e-6  # [rad] of a wanted rotation that is none
_UPRIGHT, _LEANING = np.deg2rad((1.5, 3.5))  # of a lean, up to and from where on the place winds up, and does not
_UNHURRIED = 0.1  # of the speed at which a tool is turned back about its force: nothing tips there
_STEADY_LOOPS = 3.0  # times of the loop, over which the deflection counts that torques are balanced at
_IMAGES = 30  # that noise is judged by
_FOURTH = np.array((-1.0, 3.0, -3.0, 1.0))  # of steps: the fourth difference of what they lead to
_OF_WHITE = 1.538 * 70.0**0.5  # median size of three components of a fourth difference of white noise, over its own
_SET_BACK = 1.0  # [s] an answer earlier than the last by this: the clock was set back
SIDE_LOOPS = 1.5  # times of a deflection that is fed forward, in which a side force is given way to: nothing hurries


class RotationNoise:
    """White noise of rotations, whatever the tool does: their fourth difference over images leaves no slow motion.

    What covariance states is more: errors that stay do not jump from image to image, and no smoothing takes them away.
    """

    def __init__(self) -> None:
        self._last: Array | None = None
        self._steps: deque[Array] = deque(maxlen=len(_FOURTH))
        self._sizes: deque[float] = deque(maxlen=_IMAGES)

    def update(self, R: Array, stated: float) -> float:
        """Standard deviation of a component [rad] with the rotation R (3, 3) of a new image, at most what is stated."""
        if self._last is not None:
            self._steps.append(so3_log(self._last.T @ R))
        self._last = R
        if len(self._steps) == len(_FOURTH):
            fourth = _FOURTH @ np.array(self._steps)
            self._sizes.append(length(fourth) / _OF_WHITE)
        if len(self._sizes) < _IMAGES // 2:
            return stated
        return min(sorted(self._sizes)[len(self._sizes) // 2], stated)


class ToolFilter:
    """The tool in the grasp and in the world, smoothed. The first image is taken over as it is.

    Attributes:
        R_WT: (3, 3), by as much as the noise of rotations asks; X_WT: (4, 4) with the tip at its place,
            over `force_filter`. Both are the newest image's where the pose is not smoothed.
        p_TC: (3,) [m], spring: load on the tool in T, on_environment: in W, over `rotation_filter`.
        discrepancy: between bushing and wrench model, in T, over `discrepancy_filter`; None while the model is the
            bushing.
    """

    def __init__(self, parameters: ControllerParameters, p_Ttip: Array, smoothed: bool) -> None:
        self._parameters, self._p_Ttip, self._smoothed = parameters, p_Ttip, smoothed
        self._stamp = -inf
        self._noise = RotationNoise()
        self._tip = np.zeros(3)
        self.R_WT, self.X_WT, self.p_TC = np.eye(3), np.eye(4), np.zeros(3)
        self.spring = self.on_environment = Wrench.zero()
        self.discrepancy: Wrench | None = None

    def turn(self, step: Array) -> None:
        """The tool was turned by step (3, 3) in W since the last image: what is smoothed goes along."""
        self.R_WT = step @ self.R_WT

    def update(self, m: Measurement) -> None:
        """Take in one image."""
        p, dt = self._parameters, m.stamp - self._stamp
        self._stamp = m.stamp
        noise = self._noise.update(m.X_WT[:3, :3], m.rotation_deviation)
        a = low_pass_share(dt, p.rotation_filter)
        self.p_TC = self.p_TC + a * (m.X_TC[:3, 3] - self.p_TC)
        self.spring = _mixed(self.spring, m.spring, a)
        self.on_environment = _mixed(self.on_environment, m.on_environment, a)
        if m.discrepancy is None:
            self.discrepancy = None
        else:
            b = low_pass_share(dt, p.discrepancy_filter)
            self.discrepancy = m.discrepancy if self.discrepancy is None else _mixed(self.discrepancy, m.discrepancy, b)
        if not self._smoothed or dt == inf:
            self.R_WT, self._tip = m.X_WT[:3, :3], m.tip
        else:
            smoothing = p.rotation_filter * min(noise / ROTATION_DEVIATION, 1.0)
            self.R_WT = self.R_WT @ so3_exp(low_pass_share(dt, smoothing) * so3_log(self.R_WT.T @ m.X_WT[:3, :3]))
            self._tip = self._tip + low_pass_share(dt, p.force_filter) * (m.tip - self._tip)
        self.X_WT = make_pose(self.R_WT, self._tip - self.R_WT @ self._p_Ttip)


class DeflectionFilter:
    """The deflection that is fed forward, slowly.

    Attributes:
        parameters: in use; their limits may change.
        q: (3,) rpy of R_TC [rad]. steady: the same, over three loop times.
        tip_to_C: (3,) from the tip to the gripper, in W [m].
        yielded: (3,) part of tip_to_C in which the gripper gives way to a side force, in W [m].
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        self.parameters = parameters
        self._stamp = -inf
        self._turn = WantedTurn()
        self.q, self.steady = np.zeros(3), np.zeros(3)
        self.tip_to_C, self.yielded = np.zeros(3), np.zeros(3)

    @property
    def turned(self) -> tuple[Array, Array]:
        """By how much the wanted tool turned (3, 3) in W: since the last image, and since the newest was taken."""
        return self._turn.step, self._turn.since

    def update(
        self,
        m: Measurement,
        loop_time: float,
        tipping_gain: float,
        yielding: Array | None = None,
        R_WT_des: Array | None = None,
        held: AxisFlags = (True, True, True),
        pressing: Array | None = None,
    ) -> None:
        """Take in one image.

        What is fed forward has the tipping gain in its loop, so its time grows with it. While a tip sticks, the place
        winds up, and what it is shifted by leans a tool near tipping: it has to be much slower than the uprighting, and
        waits while the tool leans.

        Args:
            loop_time: [s] from the image to the arm's answer.
            tipping_gain: how many times further than the gripper the tool turns, 1 or more.
            yielding: (3, 3) in W, along side directions the grasp's stiffness over the one that the tip shall feel;
                None where none counts.
            R_WT_des: (3, 3) wanted of the tool, with which tip_to_C turns about the axes of T that are held; None:
                nothing is followed.
            held: which axes of T hold their angle.
            pressing: (3,) unit vector of the wanted force, in T; None: no force. A turn about it tips nothing, and is
                answered slowly: a blade that yaws as it sticks and slips would swing the more.
        """
        p, dt = self.parameters, m.stamp - self._stamp
        self._stamp = m.stamp
        least = p.feedforward_ratio * loop_time
        fast = low_pass_share(dt, max(p.angle_feedforward, least) * tipping_gain)
        slow = low_pass_share(dt, max(p.position_feedforward, least) * tipping_gain**3)
        q = rpy_from_rotation(m.X_TC[:3, :3])
        self.steady = self.steady + low_pass_share(dt, _STEADY_LOOPS * loop_time) * (q - self.steady)
        left = q - self.q
        slow *= _upright(left * held)
        speed = np.ones(3) if pressing is None else 1.0 - (1.0 - _UNHURRIED) * pressing * pressing  # by axis
        self.q = self.q + fast * speed * left
        seen = m.X_WC[:3, 3] - m.tip
        if self._turn.update(R_WT_des, held, m.stamp, loop_time, p.max_angular_speed):
            self.tip_to_C, seen = self._turn.step @ self.tip_to_C, self._turn.since @ seen
        self.tip_to_C = self.tip_to_C + slow * (seen - self.tip_to_C)
        if yielding is None:
            self.yielded = np.zeros(3)
            return
        # F = K d at the gripper's C = tip + d + ..., commanded to give way by (K / k) d: the loop has that gain
        gain = max(sum(yielding.diagonal().tolist()), 1.0)
        gentle = low_pass_share(dt, SIDE_LOOPS * max(p.position_feedforward, least) * gain)
        deflection = m.X_WT[:3, :3] @ m.X_TC[:3, 3]
        self.yielded = self.yielded + gentle * (yielding @ deflection - self.yielded)


class WantedTurn:
    """How a wanted rotation has turned: a tool that tilts about its tip takes the gripper with it at once.

    Attributes:
        step: (3, 3) in W, since the last image. since: (3, 3) in W, since the newest image was taken.
    """

    def __init__(self) -> None:
        self._answers: deque[tuple[float, Array]] = deque()  # [s] when the arm is there, and the rotation
        self.step = self.since = np.eye(3)

    def update(self, R: Array | None, held: AxisFlags, stamp: float, loop_time: float, speed: float) -> bool:
        """Take in what is wanted as an image of that stamp [s] is answered loop_time [s] later; whether it turns.

        speed: [rad/s] at which the gripper turns at most.
        """
        answers = self._answers
        if R is None:
            answers.clear()
            return False
        now = stamp + loop_time
        if not answers:
            answers.append((now, R))
            return False
        at, before = answers[-1]
        self.step = np.eye(3)
        if now < at - _SET_BACK:
            answers.clear()
            answers.append((now, R))
            return False
        if now <= at:
            return False
        R = R if R is before else self._towards(R, before, held, speed * (now - at))
        answers.append((now, R))
        while len(answers) > 2 and answers[1][0] <= stamp:
            answers.popleft()
        if all(old is R for _, old in answers):
            self.step = self.since = np.eye(3)
            return False
        (early, first), (late, second) = answers[0], answers[1]
        share = min(max((stamp - early) / (late - early), 0.0), 1.0)
        then = first @ so3_exp(share * so3_log(first.T @ second))
        self.step, self.since = R @ before.T, R @ then.T
        return True

    def _towards(self, R: Array, before: Array, held: AxisFlags, most: float) -> Array:
        """By `most` [rad] at most, about the axes that are held; `before` itself where that is nowhere."""
        turn = so3_log(before.T @ R) * held
        size = length(turn)
        if size < _NO_TURN:
            return before
        return np.asarray(before @ so3_exp(turn * min(most / size, 1.0)))


def _upright(lean: Array) -> float:
    """Share (1 to 0) of a lean (3,) [rad] that is still to be answered, in which the tool counts as upright."""
    size = length(lean)
    return float(min(max((_LEANING - size) / (_LEANING - _UPRIGHT), 0.0), 1.0))


def _mixed(a: Wrench, b: Wrench, share: float) -> Wrench:
    return Wrench(a.torque + share * (b.torque - a.torque), a.force + share * (b.force - a.force))
