# SPDX-License-Identifier: Apache-2.0
"""What the operator page says of a cell, what its plots hold, and to whom its server speaks."""

import ast
import asyncio
import re
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

pytest.importorskip("viser", reason="needs viser (./seed test has it)")
import viser
import websockets

import seed_control
import seed_core
import seed_driver
import seed_estimation
import seed_ros
import seed_sim
import seed_ur
from seed_bringup.page import style, words
from seed_bringup.page.panel import Panel, Playing, _rows
from seed_bringup.page.scene import Scene
from seed_bringup.page.server import PageServer
from seed_bringup.page.slow_browser import SCRIPT
from seed_bringup.page.state import CellState, ControlView, GraspView, History
from seed_control.parameters import ControllerParameters
from seed_control.state import EventLog
from seed_control.wrench.inputs import Inputs
from seed_core.hand import Tool

HELD = GraspView(np.eye(4), True, "", 0.02, False)


def control(mode: str, reason: str = "", enabled: bool = True, t: float = 1.0, force: float = 0.0) -> ControlView:
    six = np.array((0.0, 0.0, force, 0.0, 0.0, 0.0))
    return ControlView(t, enabled, mode, reason, mode == "contact", False, six, six + 0.1, np.full(6, 0.05))


def test_before_a_cell_the_page_says_how_to_start_one() -> None:
    found = words.headline(CellState())
    assert found.word == "No cell yet"
    assert "./seed launch cell" in found.todo
    assert words.next_button(CellState()) == ""


def test_a_stale_input_is_told_with_where_to_look_for_it() -> None:
    inputs = Inputs(ControllerParameters(), True, EventLog(""))
    assert "driver" in words.remedy(inputs.staleness(1.0))
    inputs.add_kinematics(1.0, np.eye(4))
    assert "cameras" in words.remedy(inputs.staleness(1.0))
    inputs.arrived = 0.0
    assert "cameras" in words.remedy(inputs.staleness(1.0))


@pytest.mark.parametrize("part", [part for part, _ in words.REMEDIES])
def test_every_remedy_is_of_words_that_a_reason_has(part: str) -> None:
    for package in (seed_core, seed_ur, seed_estimation, seed_control, seed_driver, seed_ros, seed_sim):
        if any(part in f.read_text(encoding="utf-8") for f in Path(package.__file__).parent.glob("**/*.py")):
            return
    pytest.fail(f"no package gives a reason with '{part}'")


PLAIN = {
    "",
    "starting",
    "the driver is shutting down",
    "held for a reason that was not told",
}  # nothing helps but Enable


def _reasons() -> list[str]:
    """Texts of controller and arms that are held with, or kept as a reason, as they stand in the source."""
    found = []
    for package in (seed_core, seed_control, seed_driver):
        for file in Path(package.__file__).parent.glob("**/*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                given: list[ast.expr] = []
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "hold":
                    given = node.args
                elif isinstance(node, ast.Assign) and getattr(node.targets[0], "attr", "") in ("reason", "_loaded"):
                    given = [node.value]
                found += [_text(g) for g in given if isinstance(g, ast.Constant | ast.JoinedStr)]
    return sorted({reason for reason in found if reason is not None})


def _text(node: ast.expr) -> str | None:
    """Of a literal; '~' for each value in it. None: it is no text, or one of values alone."""
    if isinstance(node, ast.JoinedStr):
        text = "".join(v.value if isinstance(v, ast.Constant) else "~" for v in node.values)
        return text if re.search(r"[a-z]{3}", text) else None
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def test_what_controller_and_driver_hold_for_has_a_remedy() -> None:
    reasons = _reasons()
    assert len(reasons) > 15, "the texts are not found where they were"
    lacking = [r for r in reasons if words.remedy(r) == words.OTHERWISE and r not in PLAIN]
    lacking = [r for r in lacking if not r.startswith(("~: ", "~; "))]  # another reason, and what to do
    assert not lacking


def test_a_cell_that_has_gone_silent_is_told_whatever_it_said_last() -> None:
    found = words.headline(CellState(now=1.0, control=control("contact"), silent=7.0))
    assert (found.level, found.word) == ("bad", "Cell is silent")
    assert "7 s" in found.text
    idle = CellState(now=1.0, control=control("idle"), grasp=HELD, silent=7.0)
    assert words.next_button(idle) == "", "no button leads on, so none is in colour"


@pytest.mark.parametrize(
    ("reason", "remedy"),
    [
        ("deflection 14.1 mm is beyond 12.0 mm: the tool may slip", "Grasp"),
        ("the arm does not follow: it is 31.0 mm from its command", "pendant"),
        ("current_pose is 0.30 s old", "driver"),
        ("track lost: the tool touches no finger", "Grasp"),
        ("no grasp: initialize_grasp has not been called since the last reference", "Take the tool"),
        ("no contact within max_free_travel = 30 mm along (0, 0, -1) of the base", "frame"),
        ("estimated force 45.0 N is beyond 40 N", "bound"),
        ("the tool's pose has jumped by 3.0 mm and 1.0 degrees: the tool has slid", "membranes"),
        ("the gripper does not follow: it grips with 4.0 N where 20.0 N were asked for", "gripper"),
        ("the arm holds: robot is powered off", "driver/power_on"),
        ("the arm holds: emergency stop (system)", "Release the button"),
        ("the arm holds: safety fault", "driver/restart_safety"),
        ("link lost: the controller's clock stands still", "cable"),
        ("the controller's clock went back by 70.0 s; call resend_robot_program", "started anew"),
        (
            "the clock of the estimator's computer is 9.0 ms ahead of the controller's: synchronise the two",
            "Synchronise",
        ),
        ("the clock of the cameras was set back; set it right, or compare the clocks", "identify --live"),
        ("in free air the tool seems to press with 4.0 N: initialize the grasp free of load", "nothing presses"),
        ("something that nobody has thought of", "Clear the cause"),
    ],
)
def test_a_hold_is_told_with_its_reason_and_what_to_do(reason: str, remedy: str) -> None:
    found = words.headline(CellState(now=1.0, control=control("holding", reason), grasp=HELD))
    assert (found.level, found.word) == ("bad", "Holds")
    assert found.text[1:].startswith(reason[1:])
    assert remedy in found.todo
    assert "Enable" in found.todo


def test_the_next_button_leads_from_reference_to_grasp_to_enable_to_play() -> None:
    off = control("disabled", enabled=False)
    nothing = GraspView(np.eye(4), False, "no reference: capture_reference has not been called", 0.0, False)
    empty = GraspView(
        np.eye(4), False, "no grasp: initialize_grasp has not been called since the last reference", 0.0, False
    )
    steps = [words.next_button(CellState(now=1.0, control=off, grasp=g)) for g in (nothing, empty, HELD)]
    assert steps == ["Reference", "Grasp", "Enable"]
    assert words.next_button(CellState(now=1.0, control=control("idle"), grasp=HELD)) == words.PLAY


def test_a_number_that_rounds_to_zero_has_no_sign() -> None:
    X_WE, still = np.eye(4), replace(control("idle"), measured=np.array((-0.04, -0.06, 0.0, -0.004, 0.004, -0.0)))
    X_WE[:3, 3] = -0.0004, 0.4, -0.0006
    rows = dict(_rows(CellState(now=1.0, control=still, X_WE=X_WE), 1))
    assert rows["force x, y, z [N]"] == "0.0, -0.1, 0.0"
    assert rows["torque x, y, z [N m]"] == "0.00, 0.00, 0.00"
    assert rows["flange x, y, z [mm]"] == "0, 400, -1"


def test_a_tool_that_follows_positions_may_stand_as_it_does_after_a_task() -> None:
    found = words.headline(CellState(now=1.0, control=control("position"), grasp=HELD))
    assert found.word == "Follows positions"
    assert "or stands there" in found.text


def test_after_a_reset_the_page_names_the_button_that_leads_on() -> None:
    reason, off = "sim/reset has put it at its start", control("disabled", enabled=False)
    nothing = GraspView(np.eye(4), False, "no reference: capture_reference has not been called", 0.0, False)
    empty = GraspView(np.eye(4), False, "track lost: the tool touches no finger", 0.0, False)
    for view in (off, control("holding", f"the arm holds: {reason}")):
        told = [words.headline(CellState(now=1.0, control=view, grasp=g, arm_holds=reason)) for g in (nothing, empty)]
        assert [t.todo.split(",")[0] for t in told] == ["Next: Reference", "Next: Grasp the tool. Then Enable"]


def test_tasks_for_another_tool_are_not_offered_and_the_note_names_it() -> None:
    tools = {"mine.yaml": "pen", "find_edge": "ball", "pen": "pen", "squeegee": "squeegee", "any": "", "write": "pen"}
    tasks = tuple(tools)
    assert set(words.offer(tasks, tools, "").tasks) == set(tasks)  # the tool is not known yet
    assert words.offer(tasks, tools, "squeegee").tasks == ("squeegee", "any")
    assert words.offer(tasks, tools, "squeegee").note == "The hand holds 'squeegee'. Not offered: tasks for ball, pen."
    assert words.offer(tasks, tools, "pen").tasks == ("mine.yaml", "pen", "any", "write")  # own, the tool's own, others
    assert words.offer(tasks, tools, "pen", "write").tasks[0] == "write"  # that the cell was launched with
    assert words.offer(tasks, tools, "pen", "/here/new.yaml").tasks[0] == "/here/new.yaml"
    assert words.offer(tasks, tools, "pen", "squeegee").tasks[0] == "mine.yaml"
    none = words.offer(("pen",), {"pen": "pen"}, "scraper")
    assert none.tasks == ("pen",)
    assert "'scraper'" in none.note


def test_slip_is_told_in_plain_words() -> None:
    def told(slip: float, gross: bool = False) -> words.Headline:
        return words.slip_words(CellState(now=1.0, grasp=HELD.__class__(np.eye(4), True, "", slip, gross)))

    assert told(0.02).word == "held firmly (slip 2 %)"
    assert [told(s).level for s in (0.0, 0.2, 0.4)] == ["good", "warn", "bad"]
    assert told(0.0, gross=True).level == "bad"


def test_words_of_a_cell_cannot_become_part_of_the_page() -> None:
    evil = "<img src=x onerror=alert(1)>"
    html = (
        style.status(words.Headline("bad", "Holds", evil, evil))
        + style.table([(evil, evil)])
        + style.said([(True, evil)])
    )
    assert "<img" not in html
    assert html.count("&lt;img") == 5


def test_history_keeps_its_span_and_begins_anew_when_time_goes_back() -> None:
    history = History(span=2.0)
    for t in np.arange(0.0, 5.0, 0.5):
        history.add(control("contact", t=float(t), force=-10.0))
    ago, wanted, measured, low, high = history.series(2, 4.5)
    np.testing.assert_allclose(ago, [-2.0, -1.5, -1.0, -0.5, 0.0])
    np.testing.assert_allclose(wanted, -10.0)
    np.testing.assert_allclose(high - low, 4 * 0.05)  # two deviations to either side
    np.testing.assert_allclose(0.5 * (high + low), measured)
    history.add(control("contact", t=1.0))
    assert len(history.series(2, 1.0)[0]) == 1


def test_the_plot_shows_the_axis_on_which_most_is_wanted() -> None:
    history = History()
    assert history.axis(slice(0, 3), 2) == 2
    six = np.array((4.0, 0.0, -1.0, 0.0, 0.0, 0.0))
    history.add(ControlView(0.0, True, "contact", "", True, True, six, six, np.zeros(6)))
    assert history.axis(slice(0, 3), 2) == 0
    assert history.axis(slice(3, 6), 3) == 3


@pytest.fixture(scope="module")
def server() -> Iterator[PageServer]:
    server = PageServer(port=0)
    yield server
    server.stop()


class Idle:
    """Hands that have nothing to do."""

    tasks = ("any", "pen", "squeegee", "wipe")
    tools: ClassVar = {"pen": "pen", "squeegee": "squeegee", "wipe": "squeegee"}
    playing, said = Playing(), ()
    begun, simulated = "", False

    def stop(self) -> None: ...
    def press(self, button: str) -> None: ...
    def play(self, task: str, force: float | None) -> None: ...


def test_the_task_that_was_chosen_stays_while_it_is_offered(server: PageServer) -> None:
    hands = Idle()
    panel = Panel(server, History(), Scene(server), hands)

    def selected(tool: str, begun: str = "") -> str:
        hands.begun = begun
        panel.show(CellState(tool=Tool(tool) if tool else None), 0, numbers=False)
        return panel._task.value

    assert selected("", "wipe") == "wipe"  # that the cell was launched with
    assert selected("squeegee", "squeegee") == "squeegee"
    assert selected("") == "squeegee"  # silence
    assert selected("squeegee", "squeegee") == "squeegee"
    panel._task.value = "wipe"
    assert selected("") == "wipe"
    assert selected("squeegee", "squeegee") == "wipe"
    assert selected("pen") == "pen"  # the chosen one is for another tool
    panel._task.value = "any"
    assert selected("squeegee", "wipe") == "any"


def test_the_server_listens_on_loopback_alone(server: PageServer) -> None:
    listening = {
        line.split()[1]
        for line in open("/proc/net/tcp").read().splitlines()[1:]  # noqa: SIM115
        if int(line.split()[1].split(":")[1], 16) == server.get_port() and line.split()[3] == "0A"
    }
    assert {address.split(":")[0] for address in listening} == {"0100007F"}  # 127.0.0.1


def test_a_page_of_another_site_cannot_press_buttons(server: PageServer) -> None:
    async def answer(origin: str | None) -> int:
        port, protocol = server.get_port(), websockets.Subprotocol(f"viser-v{viser.__version__}")
        try:
            async with websockets.connect(f"ws://127.0.0.1:{port}", origin=origin, subprotocols=[protocol]):  # type: ignore[arg-type]
                return 101
        except websockets.InvalidStatus as error:
            return error.response.status_code

    own = f"http://127.0.0.1:{server.get_port()}"
    origins = (own, own.replace("127.0.0.1", "localhost"), None, "http://evil.example", "http://127.0.0.1.evil.example")
    assert [asyncio.run(answer(o)) for o in origins] == [101, 101, 101, 403, 403]


def test_the_page_comes_whole_with_the_script_for_browsers_that_draw_in_software(server: PageServer) -> None:
    asked = urllib.request.Request(f"{server.address}/", headers={"Accept-Encoding": "gzip"})
    with urllib.request.urlopen(asked, timeout=5.0) as answer:
        text, length = answer.read().decode(), int(answer.headers["Content-Length"])
    assert len(text.encode()) == length
    head = text.index("<head>") + len("<head>")
    assert text[head:].startswith(SCRIPT)  # before viser's own
    assert text.rstrip().endswith("</html>")
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(f"{server.address}/none.html", timeout=5.0)


def test_a_port_that_is_taken_is_left_to_whoever_has_it(server: PageServer) -> None:
    second = PageServer(port=server.get_port())
    try:
        assert second.get_port() != server.get_port()
        with socket.create_connection(("127.0.0.1", second.get_port()), timeout=2.0):
            pass
    finally:
        second.stop()


def test_the_page_is_not_shared_beyond_this_computer(server: PageServer) -> None:
    assert server.request_share_url() is None
