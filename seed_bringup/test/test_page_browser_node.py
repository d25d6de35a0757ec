# SPDX-License-Identifier: Apache-2.0
"""The operator page in a real browser, beside a real simulated cell: what is clicked happens, what happens is seen."""

import contextlib
import io
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("viser", reason="needs viser (./seed test has it)")
pytest.importorskip("pydrake", reason="needs Drake")
pytest.importorskip("playwright", reason="needs Playwright (./seed test has it)")

import rclpy
from PIL import Image
from playwright.sync_api import sync_playwright
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from seed_msgs.msg import ControllerState

from seed_bringup.launching.launcher import Launch
from seed_bringup.page.browser import BROWSERS, FLAGS
from seed_ros import QUEUE

ROOT = Path(__file__).resolve().parents[2]
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
pytestmark = [
    pytest.mark.ros,
    pytest.mark.alone,
    pytest.mark.skipif(BROWSER is None, reason=f"none of {', '.join(BROWSERS)} is here: apt-get install chromium"),
]
SLOW = 60_000.0  # [ms] that a browser that draws by software may take


class Watcher(Node):
    """Hears the controller in a thread of its own."""

    def __init__(self, context: Context) -> None:
        super().__init__("watcher", context=context)
        self.state = ControllerState()
        self.disabled_at = 0.0  # [s], by the machine's clock
        self.create_subscription(ControllerState, "controller/state", self._on_state, QUEUE)

    def _on_state(self, message: ControllerState) -> None:
        if self.state.enabled and not message.enabled:
            self.disabled_at = time.time()
        self.state = message


@pytest.fixture(scope="module")
def watcher() -> Iterator[Watcher]:
    context = Context()
    rclpy.init(args=[], context=context)
    node, executor = Watcher(context), SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def spin() -> None:
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    yield node
    rclpy.try_shutdown(context=context)
    thread.join(2.0)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Of the page of a running cell."""
    lines: list[str] = []
    told = threading.Event()

    def hear(label: str, line: str) -> None:
        lines.append(f"[{label}] {line}")
        if label == "page" and "http://" in line:
            told.set()

    arguments = {"method": "truth", "view": "true", "view_port": "0", "links": "false", "sim_rate": "125.0"}
    with Launch(ROOT / "seed_bringup/launch/cell_launch.xml", arguments | {"use_sim_time": "true"}, output=hear):
        assert told.wait(60.0), lines
        yield next(line for line in lines if "http://" in line).split()[-1]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=BROWSER, args=FLAGS, env={**os.environ})
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def requests() -> list[str]:
    """Every address that a page has asked for."""
    return []


@pytest.fixture(scope="module")
def page(browser: Any, address: str, requests: list[str]) -> Any:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(SLOW)
    page.on("request", lambda r: requests.append(r.url))
    page.on("websocket", lambda w: requests.append(w.url))
    page.goto(address)
    page.get_by_role("button", name="STOP").wait_for()
    return page


def press(page: Any, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def until(condition: Callable[[], Any], patience: float = 30.0) -> None:
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def picture(page: Any) -> np.ndarray:
    """The 3-D view (H, W, 3)."""
    shot = Image.open(io.BytesIO(page.locator("canvas").first.screenshot())).convert("RGB")
    return np.asarray(shot, float)


def test_stop_is_the_first_that_tab_reaches(page: Any) -> None:
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.innerText") == "STOP"


def test_a_browser_that_draws_in_software_draws_no_more_pictures_than_the_cell_has(page: Any) -> None:
    assert page.evaluate("document.documentElement.dataset.drawnIn") == "software"
    page.wait_for_function("performance.now() > 4000")  # until then, as it opens, every picture is drawn
    count = """() => new Promise((done) => {
      let frames = 0;
      const began = performance.now();
      const next = () => {  // by the clock: the time that a picture is given lags behind in a busy browser
        frames += 1;
        performance.now() - began > 2000 ? done(frames) : requestAnimationFrame(next);
      };
      requestAnimationFrame(next);
    })"""
    assert page.evaluate(count) < 36  # 16 a second; a screen would ask for 60


def test_buttons_reach_the_nodes_and_the_task_is_seen(page: Any, watcher: Watcher) -> None:
    page.get_by_text("Not enabled").wait_for()
    press(page, "Grasp")
    page.get_by_text("grasped the squeegee").wait_for()
    assert not watcher.state.enabled
    press(page, "Enable")
    until(lambda: watcher.state.enabled)
    page.get_by_text("Ready").wait_for()
    page.get_by_text("Not offered: tasks for ball").wait_for()  # the hand holds a squeegee
    assert page.get_by_label("Task").first.input_value() == "squeegee"
    before = picture(page)
    press(page, "Play task")
    until(lambda: watcher.state.mode != "idle")
    page.get_by_text("squeegee: ").wait_for()  # the phase, and how much is done
    time.sleep(1.0)
    changed = (np.abs(picture(page) - before).max(axis=-1) > 30.0).mean()
    assert changed > 0.005, "the arm moves, and the picture does not"


def test_the_view_from_above_is_another_picture(page: Any) -> None:
    before = picture(page)
    page.get_by_text("Above", exact=True).click()
    until(lambda: (np.abs(picture(page) - before).max(axis=-1) > 30.0).mean() > 0.05)


def test_stop_stops_within_three_tenths_of_a_second_of_the_click(page: Any, watcher: Watcher) -> None:
    assert watcher.state.enabled  # it still plays
    page.evaluate("window.addEventListener('click', () => { window.clicked = Date.now() }, true)")
    press(page, "STOP")
    until(lambda: watcher.disabled_at)
    assert watcher.disabled_at - 1e-3 * page.evaluate("window.clicked") < 0.3
    page.get_by_text("controller comes to rest").wait_for()


def test_a_second_page_shows_the_same_and_its_stop_works_as_well(
    browser: Any, address: str, requests: list[str], page: Any, watcher: Watcher
) -> None:
    second = browser.new_page(viewport={"width": 1000, "height": 700})
    second.set_default_timeout(SLOW)
    second.on("request", lambda r: requests.append(r.url))
    second.goto(address)
    second.get_by_text("controller comes to rest").wait_for()  # said before it was opened
    press(page, "Enable")
    until(lambda: watcher.state.enabled)
    second.keyboard.press("s")  # the key of Stop
    until(lambda: not watcher.state.enabled)
    second.close()


def test_nothing_that_the_page_asks_for_leaves_this_computer(page: Any, address: str, requests: list[str]) -> None:
    page.wait_for_timeout(500.0)
    host = address.removeprefix("http://")
    outside = [r for r in requests if not r.startswith((f"http://{host}", f"ws://{host}", "data:", "blob:"))]
    assert not outside
    assert any(r.startswith("ws://") for r in requests)
