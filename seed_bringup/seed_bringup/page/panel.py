# SPDX-License-Identifier: Apache-2.0
"""What is beside the 3-D view: Stop, state, buttons and answers; plots and tactile pictures on the other side."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import viser

from seed_bringup.page import style, words
from seed_bringup.page.plots import Plots
from seed_bringup.page.scene import VIEWS, Scene
from seed_bringup.page.state import CellState, History

LINES = 4  # of answers
OWN_FORCE = 0.0  # [N] entered for the task's own
FORCE_HINT = "0: the force that the task asks for. Any other: the size of every force in it."
NO_PICTURE = np.full((96, 288, 3), 245, np.uint8)


class Playing(NamedTuple):
    """A task on its way; share: of all of it, 0 to 1."""

    task: str = ""
    phase: str = ""
    share: float = 0.0


class Hands(Protocol):
    """What the buttons do; every method returns at once, and what comes of it stands in `said`."""

    tasks: Sequence[str]
    tools: Mapping[str, str]  # that each task is made for
    playing: Playing
    said: Sequence[tuple[bool, str]]  # whether it was done, and the words; the newest first

    @property
    def begun(self) -> str: ...  # task that the cell was launched with; '' where nobody says
    @property
    def simulated(self) -> bool: ...  # whether the gripper is simulated, and can let go
    def stop(self) -> Any: ...
    def press(self, button: str) -> Any: ...
    def play(self, task: str, force: float | None) -> Any: ...


class Panel:
    """`show` a state."""

    def __init__(self, server: viser.ViserServer, history: History, scene: Scene, hands: Hands | None) -> None:
        """hands: None where there is nothing to run, as with a bag."""
        self._gui, self._hands = server.gui, hands
        server.gui.main_panel.dock_left()
        server.gui.main_panel.set_width(330)
        if hands is not None:
            self._stop = self._add_stop(hands)
        else:
            server.gui.add_html(style.sheet(""))
        self._status = server.gui.add_html("")
        if hands is not None:
            self._add_buttons(hands)
        side = server.gui.add_panel()
        with side.add_tab("Measured"):
            self._plots = Plots(server.gui, history)
            self._picture_title = server.gui.add_html("")
            self._picture = server.gui.add_image(NO_PICTURE, format="jpeg", jpeg_quality=80)
            self._picture_note = server.gui.add_html("")
            self._table = server.gui.add_html("")
            with server.gui.add_folder("View"):
                views = server.gui.add_button_group("Look", tuple(VIEWS), hint="Key A: from above")
                views.on_click(lambda event: scene.look(views.value, event.client))
                above = server.gui.add_command("Look from above", hotkey="A", description="At tool and table")
                above.on_trigger(lambda event: scene.look("Above", event.client))
                follow = server.gui.add_checkbox("Follow the tool", scene.follow)
                named = server.gui.add_checkbox("Show frames", scene.named)
            follow.on_update(lambda _: setattr(scene, "follow", follow.value))
            named.on_update(lambda _: setattr(scene, "named", named.value))
        side.dock_right()
        side.set_width(350)

    def _add_stop(self, hands: Hands) -> viser.GuiButtonHandle:
        stop = self._gui.add_button(
            "STOP", color="red", icon=viser.Icon.HAND_STOP, hint="The arm comes to rest. Key: S"
        )
        stop.on_click(lambda _: hands.stop())
        key = self._gui.add_command("Stop the arm", hotkey="S", description="It comes to rest where it is")
        key.on_trigger(lambda _: hands.stop())
        self._gui.add_html(style.sheet(stop._impl.uuid))
        return stop

    def _add_buttons(self, hands: Hands) -> None:
        gui = self._gui
        hints = {
            "Reference": "Take pictures of the empty bubbles: nothing may be in the gripper",
            "Grasp": "Take the tool, and call where it is now the middle",
            "Release": "Open the simulated gripper; the tool stands in its holder",
            "Enable": "Let the arm follow; nothing moves before this",
        }
        self._buttons = {}
        with gui.add_folder("Prepare"):
            for name, hint in hints.items():
                button = self._buttons[name] = gui.add_button(name, hint=hint, color="gray")
                button.on_click(lambda _, name=name: hands.press(name))  # type: ignore[misc]
        with gui.add_folder("Task"):
            self._offered = words.offer(hands.tasks, hands.tools, "")
            self._likeliest, self._held = self._offered.tasks[0], ""  # selected by itself; the last tool that was known
            self._task = gui.add_dropdown("Task", self._offered.tasks, hint="Tasks for the tool in the hand")
            self._note = gui.add_html("")
            self._force = gui.add_number("Force [N]", OWN_FORCE, min=0.0, max=50.0, step=0.5, hint=FORCE_HINT)
            gui.add_html(style.note(FORCE_HINT))
            self._play = gui.add_button(words.PLAY, icon=viser.Icon.PLAYER_PLAY, color="gray")
            self._play.on_click(lambda _: hands.play(self._task.value, self._force.value or None))
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._phase = gui.add_html("")
            self._lift = gui.add_button("Cancel: lift the tool", visible=False, color="gray")
            self._lift.on_click(lambda _: hands.press("Lift"))
        self._said = gui.add_html("")
        gui.add_html(style.note("Stop brings the arm to rest through the cell's nodes. It is no emergency stop."))

    def clear_picture(self) -> None:
        """Show no tactile pictures until others come."""
        self._picture.image = NO_PICTURE

    def show(self, state: CellState, viewers: int, numbers: bool) -> None:
        """viewers: pages that are open; numbers: whether to write plots and numbers anew as well."""
        _put(self._status, style.status(words.headline(state, live=self._hands is not None)))
        if self._hands is not None:
            self._show_hands(self._hands, words.next_button(state))
            held = state.tool.name if state.tool else ""
            self._offer(words.offer(self._hands.tasks, self._hands.tools, held, self._hands.begun), held)
        if numbers:
            self._show_numbers(state, viewers)
        self._show_picture(state)

    def _offer(self, offered: words.Offer, held: str) -> None:
        """Of the tasks those that fit the tool, as soon as it is known, and whenever it is another.

        A task that the operator has chosen stays, and any while a cell that was heard is not: if it is offered.
        """
        if offered == self._offered:
            return
        task = self._task.value
        lost = bool(self._held) and not held
        self._held = held or self._held
        self._offered = offered
        self._task.options = offered.tasks
        if task in offered.tasks and (lost or task != self._likeliest):
            set_value(self._task, task)
        else:
            self._likeliest = offered.tasks[0]
            set_value(self._task, self._likeliest)
        _put(self._note, style.note(offered.note) if offered.note else "")

    def _show_numbers(self, state: CellState, viewers: int) -> None:
        self._plots.show(state.now)
        doubt = state.touch.doubt if state.touch is not None else ""
        _put(self._table, style.table(_rows(state, viewers)) + (style.note(f"In doubt: {doubt}") if doubt else ""))
        contact = ", ".join(f"{f} {1e4 * area:.1f} cm²" for f, area in state.contact.items())
        title = f'<div class="seed-row"><span>Bubbles <small>left, right</small></span><span>{contact}</span></div>'
        _put(self._picture_title, title)

    def _show_hands(self, hands: Hands, next_button: str) -> None:
        playing = hands.playing
        for name, button in (*self._buttons.items(), (words.PLAY, self._play)):
            if (button.color is None) != (name == next_button):
                button.color = None if name == next_button else "gray"
        if self._buttons["Release"].visible != hands.simulated:
            self._buttons["Release"].visible = hands.simulated
        for handle in (self._progress, self._lift):
            if handle.visible != bool(playing.task):
                handle.visible = bool(playing.task)
        if self._play.disabled != bool(playing.task):
            self._play.disabled = bool(playing.task)
        share = round(100.0 * playing.share)
        set_value(self._progress, share)
        _put(self._phase, style.note(f"{playing.task}: {playing.phase}, {share} %") if playing.task else "")
        _put(self._said, style.said(list(hands.said)[:LINES]))

    def _show_picture(self, state: CellState) -> None:
        if state.picture is None:
            _put(self._picture_note, style.note("No tactile pictures: nobody sends them.") if state.alive else "")
            return
        _put(
            self._picture_note,
            style.note("Green: contact. Orange: motion of the tool. Blue: where the membrane creeps."),
        )
        self._picture.image = state.picture


def set_value(handle: Any, value: float | str) -> None:
    """Set an element's value, if it is another one."""
    if handle.value != value:
        handle.value = value


def _put(handle: viser.GuiHtmlHandle, content: str) -> None:
    if handle.content != content:
        handle.content = content


def _rows(state: CellState, viewers: int) -> list[tuple[str, str]]:
    control, factor = state.control, state.real_time_factor  # z in a format: no -0.0
    rows = [("tool", words.slip_words(state).word)]
    if control is not None:
        for name, unit, k, digits in (("force", "N", 0, 1), ("torque", "N m", 3, 2)):
            three = ", ".join(f"{v:z.{digits}f}" for v in control.measured[k : k + 3])
            rows.append((f"{name} x, y, z [{unit}]", three))
    if state.X_WE is not None:
        rows.append(("flange x, y, z [mm]", ", ".join(f"{1e3 * v:z.0f}" for v in state.X_WE[:3, 3])))
    if state.arm:
        rows.append(("arm", state.arm))
    if state.arm_holds:
        rows.append(("arm holds", state.arm_holds))
    if factor is not None:
        rows.append(("real-time factor", f"{factor:.2f}"))
    if viewers > 1:
        rows.append(("pages open", str(viewers)))
    return rows
