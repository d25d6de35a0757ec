# SPDX-License-Identifier: Apache-2.0
"""A cell's state, and what to do about a hold, in words."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from seed_bringup.page.state import CellState

SILENT = 2.0  # [s] without a message, after which the cell counts as gone
SLIPS, NEAR = 0.3, 0.15  # share of the tool's motion that the membrane does not follow: slips; near it


FILES = (".yaml", ".yml")


class Headline(NamedTuple):
    """`level`: good, busy, warn, bad or idle; `word`: one or two words; `text`: a sentence; `todo`: what to do."""

    level: str
    word: str
    text: str = ""
    todo: str = ""


MODES = {
    "idle": Headline("good", "Ready", "The controller holds the arm where it is and waits for a task."),
    "position": Headline(
        "busy", "Follows positions", "The tool goes where it is wanted, or stands there; no force is wanted."
    ),
    "approach": Headline("busy", "Approaches", "The tool moves towards the surface until it touches."),
    "contact": Headline("busy", "In contact", "The tool is pressed on the surface."),
}


STOPPED = "Nothing is wrong. Press Enable when the arm may move again."
PLAY = "Play task"  # name of the button
SLIPPED = "The tool moves in the fingers. Take it again (Release, Grasp), press less or grip firmer; then Enable."
JUMPED = "Look whether tool and membranes are as they were. Take the tool again (Grasp), then Enable."
GRIPPER = "Look at the gripper: its power, its force limit, its node. Then Enable."
RESTART = "Look at the arm, clear the cause, call driver/restart_safety and driver/power_on. Then Enable."
RESET = "The arm was put at its start, and the gripper is open. Grasp the tool, then Enable."
BOUND = "A bound was reached: clear the cause, then Enable. The arm begins from where it is."
# Words of a reason, and what helps against it. The first that is found counts; Enable ends every hold.
REMEDIES = (
    ("disabled by", STOPPED),
    ("stopped on request", STOPPED),
    ("jumped", JUMPED),
    ("poses are wrong since", JUMPED),
    ("free of load", "Take the tool again while nothing presses on it (Release, then Grasp). Then Enable."),
    ("the grasp cannot bear", "Take load off the tool, or hold one that is easier to grip. Then Enable."),
    ("close no further", "The gripper is at its end: hold a tool that is wider there. Then Enable."),
    ("the gripper does not", GRIPPER),
    ("the gripper was not heard", GRIPPER),
    ("slip", SLIPPED),
    ("slid", SLIPPED),
    ("frozen", "The cameras or the estimator stand still. See that the tactile pictures move, then Enable."),
    ("track lost", "The pictures do not show the tool any more. Take it again (Release, then Grasp), then Enable."),
    ("link lost", "The robot is not heard: see that it is on, and its network cable. Then Enable."),
    ("answers like no UR", "See that robot_ip is the robot's, and that its software is known. Then Enable."),
    ("does not resist", "The tool rolls over its edge. Press less, or hold its angle; put it upright, then Enable."),
    ("the clock was set back by", "The time that this computer works with was set back. Press Enable."),
    ("clock went back", "The robot's controller was started anew: see on the pendant that it is ready. Then Enable."),
    ("synchronise the two", "Synchronise the clocks of the two computers. Then Enable."),
    ("the network is slow", "See what else uses the network between the two computers. Then Enable."),
    ("ask again", "Wait a second, then Enable."),
    ("clock", "Compare the clocks of cameras and robot: ./seed identify --live. Then Enable."),
    ("no grasp", "Take the tool (Grasp), then Enable."),
    ("reference", "Open the gripper and press Reference; then Grasp."),
    ("estimated force", BOUND),
    ("relative_pose", "See that cameras and estimator run and that the tool is grasped. Then Enable."),
    ("estimate", "See that cameras and estimator run and that the tool is grasped. Then Enable."),
    ("current_pose", "The arm's driver is silent: see that it runs and is connected. Then Enable."),
    ("does not follow", "See on the pendant why the arm stands or is slowed down. Then Enable."),
    ("from its command", "See what blocks the arm, or moves it. Then Enable."),
    ("emergency stop", "Release the button and call driver/power_on. Then Enable."),
    ("safety violation", RESTART),
    ("safety fault", RESTART),
    ("safeguard stop", "Close the safeguard (a door, a light curtain). Then Enable."),
    ("brakes closed", "Call driver/power_on. Then Enable."),
    ("powered off", "Call driver/power_on. Then Enable."),
    ("local control", "Switch the robot to remote control on the pendant. Then Enable."),
    ("freedrive", "End freedrive: ./seed call driver/set_freedrive off. Then Enable."),
    ("robot program", "Enable starts the robot's program again. If it ends again, see the pendant."),
    ("protective", "Look at the arm, clear the cause, call driver/recover. Then Enable."),
    ("more than one node", "Another program steers the arm as well: end it. Then Enable."),
    ("no target_frame", "The controller was silent for a moment: is this computer too busy? Press Enable."),
    ("target_frame", "The arm refused where it was sent: see the task's positions and the workspace. Then Enable."),
    ("the surface has ended or fallen away", "The surface ends before the path does: shorten the path. Then Enable."),
    ("no contact within", "The surface is not where the task expects it: correct the task's frame. Then Enable."),
    ("nothing resists the tool", "The tool met nothing: correct where the task wants it. Then Enable."),
    ("something presses against the tool", "Clear what presses against the tool. Then Enable."),
    ("pressure of the", "Look at that bubble's membrane and its pressure sensor. Then Enable."),
    ("arm_wrench is", "The arm does not tell its force any more: see that its driver runs. Then Enable."),
    ("the limits were lowered", "The task wants more than the limits allow: change one of them. Then Enable."),
    ("the stiffness was changed", "The task does not go with the new stiffness: change one of them. Then Enable."),
    ("is no number", "Press Enable. If it comes again, record it: ./seed bag record helps to mend it."),
    ("lead away", "The arm refused where it was sent: see the task's positions and the workspace. Then Enable."),
    ("in its way", "Clear the way of the tool, then press Enable."),
    ("beyond", BOUND),
    ("reset", RESET),
)
OTHERWISE = "Clear the cause, then press Enable. The arm begins from where it is."


def remedy(reason: str) -> str:
    """What to do about the reason of a hold."""
    found = (advice for words, advice in REMEDIES if words in reason)
    return next(found, OTHERWISE) if reason else ""


def headline(state: CellState, live: bool = True) -> Headline:
    """What the cell does, most urgent first; live: not in a bag."""
    control = state.control
    if not state.alive and not live:
        return Headline(
            "idle", "Nothing yet", "The bag has nothing to show until here.", "Press Play, or move the slider."
        )
    if not state.alive:
        todo = "Start a cell in another terminal, for example with ./seed launch cell. This page joins it by itself."
        return Headline("idle", "No cell yet", "Nothing is heard of a cell.", todo)
    if state.silent > SILENT:
        todo = "What is shown is old. See the terminal of the cell; this page joins it again by itself."
        return Headline("bad", "Cell is silent", f"Nothing has been heard for {state.silent:.0f} s.", todo)
    if control is None:
        return Headline("warn", "No controller", "The cell runs, but nothing comes from its controller.")
    if control.mode == "holding":
        return Headline("bad", "Holds", _sentence(control.reason), _to_do(state, control.reason))
    if not control.enabled:
        if state.arm_holds:
            return Headline("warn", "Arm holds", _sentence(state.arm_holds), _to_do(state, state.arm_holds))
        return Headline("idle", "Not enabled", "The arm stands. " + _sentence(control.reason), _next_step(state))
    found = MODES.get(control.mode, Headline("warn", control.mode))
    if control.mode == "contact" and control.settled:
        found = Headline("good", "In contact", "The tool presses with the force that is wanted.")
    return found._replace(text=_sentence(control.reason) or found.text)


def next_button(state: CellState) -> str:
    """The button that leads on from here; empty: none."""
    control, grasp = state.control, state.grasp
    if not state.alive or control is None or state.silent > SILENT:
        return ""
    if control.enabled and control.mode != "holding":
        return PLAY
    lacks = " ".join((*state.missing.values(), grasp.reason if grasp is not None else ""))
    if "no reference" in lacks:
        return "Reference"
    return "Enable" if grasp is not None and grasp.valid else "Grasp"


def _to_do(state: CellState, reason: str) -> str:
    """The remedy of a hold; after a reset what comes next, be it the reference."""
    found = remedy(reason)
    return _next_step(state) or found if found == RESET else found


def _next_step(state: CellState) -> str:
    """How to get from standing to playing."""
    return {
        "Reference": "Next: Reference, with nothing in the gripper. Then Grasp, Enable, Play.",
        "Grasp": "Next: Grasp the tool. Then Enable, Play.",
        "Enable": "Next: Enable. Then Play.",
    }.get(next_button(state), "")


def _sentence(text: str) -> str:
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) or not text else ".")


def slip_words(state: CellState) -> Headline:
    """How well the tool sticks."""
    grasp = state.grasp
    if grasp is None:
        return Headline("idle", "unknown")
    if grasp.gross_slip:
        return Headline("bad", "has slid: grasp again")
    if not grasp.valid:
        return Headline("idle", "no pose of the tool")
    share = f"slip {100.0 * grasp.slip:.0f} %"
    if grasp.slip >= SLIPS:
        return Headline("bad", f"slides in the fingers ({share})")
    if grasp.slip >= NEAR:
        return Headline("warn", f"begins to slide ({share}, slides from {100.0 * SLIPS:.0f} %)")
    return Headline("good", f"held firmly ({share})")


class Offer(NamedTuple):
    """`tasks`: those that can be played, the likeliest first; `note`: why others are not offered, or ''."""

    tasks: tuple[str, ...]
    note: str = ""


def offer(tasks: Sequence[str], tools: Mapping[str, str], held: str, begun: str = "") -> Offer:
    """What to offer with the tool `held` in the hand ('': not known), in a cell that was begun with the task `begun`.

    Args:
        tasks: names of shipped ones, paths of own ones. tools: name of the one that each is made for; '': for any.
    """
    if begun.endswith(FILES) and begun not in tasks:
        tasks = (begun, *tasks)
    fits = [t for t in tasks if not held or tools.get(t, "") in ("", held)]
    if not fits:
        return Offer(tuple(tasks), f"No task here is for the tool in the hand, '{held}': it would be refused.")
    fits.sort(key=lambda t: (t != begun, not t.endswith(FILES), t != held))  # then own files, then the tool's own
    others = sorted({tools[t] for t in tasks if t not in fits})
    note = f"The hand holds '{held}'. Not offered: tasks for {', '.join(others)}." if others else ""
    return Offer(tuple(fits), note)
