# SPDX-License-Identifier: Apache-2.0
"""The commands of the README's walk on hardware, on a simulated cell."""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from seed_bringup.commands import cells
from seed_bringup.commands.cells import missing
from seed_bringup.demo.live import OPERATOR_TIMEOUT
from seed_bringup.launching.launcher import Launch
from seed_bringup.launching.packages import find_launch_file

pytestmark = [pytest.mark.ros, pytest.mark.realtime]  # a cell that runs by the clock

CELL = {"method": "truth", "use_sim_time": "true", "sim_rate": "125", "links": "false"}


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Launch]:
    controller = tmp_path_factory.mktemp("cell") / "controller.yaml"
    controller.write_text(f"controller: {{ros__parameters: {{operator_timeout: {OPERATOR_TIMEOUT}}}}}\n")
    arguments = CELL | {"controller_file": str(controller)}
    launch = Launch(find_launch_file(["cell"]), arguments, output=lambda label, line: print(f"[{label}] {line}"))
    with launch:
        yield launch


def test_a_name_that_is_not_there_is_told_with_what_is_like_it(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = ("/relative_pose", "/sim/ground_truth/relative_pose")
    known = (*poses, "/sim/grasp", "/sim/reset", "/estimator/capture_reference", "/controller/enable")
    listing = "; ./seed call lists what there is"
    for name, told in (
        ("/sim/grab", "none; did you mean sim/grasp? ./seed call lists what there is"),
        ("/capture_reference", "none; did you mean estimator/capture_reference? ./seed call lists what there is"),
        ("/relativ_pose", "none; did you mean relative_pose? ./seed call lists what there is"),
        ("/estimator/relativ_pose", "none; did you mean relative_pose? ./seed call lists what there is"),
        ("/sim/gone", f"none{listing}"),
        ("/nonsense", f"none{listing}"),
    ):
        assert missing("none", name, known, "./seed call") == told
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    assert missing("none", "/sim/grasp", (), "./seed call") == "none: no cell is running in ROS domain 42"


def seed(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-P", "-m", "seed_bringup.commands.dispatch", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=90.0)


def together(*lines: str) -> list[subprocess.CompletedProcess[str]]:
    """Commands that do not disturb one another, side by side: each waits for the graph most of its time."""
    with ThreadPoolExecutor() as pool:
        return list(pool.map(lambda line: seed(*line.split()), lines))


def playing(*words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-P", "-u", "-m", "seed_bringup.commands.dispatch", "play", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_without_a_cell_a_task_is_told_what_starts_one_and_a_service_is_told_apart_from_a_refusal() -> None:
    asked = ("play squeegee", "cancel", "call", "call controller/enable on", "watch", "watch controller/state")
    lines = (f"{line} --domain {domain}" for domain, line in enumerate(asked, 224))  # nobody's, and each its own
    play, cancel, *others = together(*lines)
    for done, name, domain in ((play, "play", 224), (cancel, "cancel", 225)):
        assert done.returncode == 2
        assert done.stderr == f"seed {name}: no cell is running in ROS domain {domain}: ./seed launch cell starts one\n"
    for done in others:
        assert done.returncode == 2
        assert "no cell is running" in done.stderr


class Seen:
    """A session that sees what is asked for from a time on."""

    def __init__(self, at: float) -> None:
        self.at, self.now = at, 0.0

    def there(self) -> bool:
        return self.now >= self.at

    def until(self, condition: Callable[[], bool], patience: float, _: str) -> None:
        end = self.now + patience
        while not condition() and self.now < end:
            self.now += 0.1


@pytest.mark.parametrize(
    ("launched", "at", "waited", "told"),
    [
        (2.0, 0.5, 0.5, False),  # it runs, and is met
        (2.0, 6.0, 6.0, True),
        (2.0, 99.0, 19.5, True),  # for 18 s after it is told
        (60.0, 99.0, 0.0, False),
        (math.inf, 99.0, 0.0, False),
    ],
)
def test_a_command_waits_for_a_cell_that_has_just_been_launched(
    launched: float,
    at: float,
    waited: float,
    told: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    monkeypatch.setattr(cells, "age", lambda domain: launched if domain == 7 else math.inf)
    session = Seen(at)
    cells.await_start(session, session.there, "seed play")  # type: ignore[arg-type]
    assert session.now == pytest.approx(waited, abs=0.15)
    assert capsys.readouterr().err == ("seed play: waiting for the cell to start\n" if told else "")


def test_a_launch_of_a_cell_says_that_it_is_up() -> None:
    words = ["launch", "--own", "cell", *(f"{name}:={value}" for name, value in CELL.items())]
    command = [sys.executable, "-P", "-u", "-m", "seed_bringup.commands.dispatch", *words]
    environment = os.environ | {"ROS_DOMAIN_ID": "230"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as launch:
        assert launch.stdout is not None
        told = [line for line in launch.stdout if "the cell is up" in line and not launch.terminate()]
        assert launch.wait(timeout=20.0) == 143
    (line,) = told
    assert line.startswith("[controller] [INFO]")
    assert "the cell is up; not ready: " in line
    assert line.endswith("no tool in the grasp; not enabled: call controller/enable on\n")


@pytest.mark.slow  # two tasks by simulated time
def test_a_cell_is_prepared_plays_a_task_and_lifts_the_tool_when_it_is_cancelled(cell: Launch) -> None:
    seed("call", "sim/release")  # of a run before: the cell keeps its tool
    assert seed("call", "sim/grasp").returncode == 0
    for _ in range(20):  # until the inputs are there
        enabled = seed("call", "controller/enable", "on")
        if enabled.returncode == 0:
            break
        assert enabled.returncode == 1
        assert "cannot enable" in enabled.stderr
    assert "enabled" in enabled.stdout
    with playing("squeegee", "--force", "5") as task:
        assert task.stdout is not None
        assert task.stderr is not None
        for line in task.stdout:
            if line.split()[0] == "wipe":
                break
        else:
            pytest.fail(f"the task ended early: {task.stderr.read()}")
        task.send_signal(signal.SIGINT)
        said = task.stderr.read()
        assert task.wait(timeout=60.0) == 130, said
        assert "seed play: cancelling: the tool is lifted" in said
        assert said.splitlines()[-1] == "seed play: interrupted; the task is cancelled, and the tool lifted"
        assert "seed play: a simulated arm in ROS domain" in said
        assert "Traceback" not in said
    assert "no task is being played" in seed("cancel").stderr
    with playing("squeegee", "--force", "5") as task:
        assert task.stdout is not None
        assert task.stderr is not None
        next(line for line in task.stdout if line.split()[0] == "press")
        cancelled = seed("cancel")
        assert cancelled.returncode == 0, cancelled.stderr
        assert task.wait(timeout=60.0) == 1
        assert "cancelled" in task.stderr.read()
    other = seed("play", "pen")
    assert other.returncode == 1
    assert "made for the tool 'pen'" in other.stderr
    done = seed("play", "squeegee", "--force", "5")
    assert done.returncode == 0, done.stderr
    assert "done in" in done.stdout
    assert seed("call", "controller/enable", "off").returncode == 0
    refused = seed("play", "squeegee")
    assert refused.returncode == 1
    assert "then call controller/enable on" in refused.stderr
    assert cell.poll() is None


def test_services_are_listed_and_wrong_calls_are_named(cell: Launch) -> None:
    until = time.monotonic() + 60.0
    while "/controller/enable on|off\n" not in (listed := seed("call")).stdout:
        assert time.monotonic() < until, listed
    assert "/sim/grasp\n" in listed.stdout
    switch, trigger, gone, near, _ = together(
        "call controller/enable", "call /sim/grasp on", "call sim/gone", "call sim/grab", "call sim/release"
    )
    assert switch.returncode == 2
    assert "say on or off" in switch.stderr
    assert trigger.returncode == 2
    assert "takes neither" in trigger.stderr
    assert gone.returncode == 2
    assert "no service /sim/gone; ./seed call lists what there is" in gone.stderr
    assert "did you mean sim/grasp?" in near.stderr
    refused = seed("call", "controller/enable", "on")  # without a tool
    assert refused.returncode == 1
    assert "/controller/enable: cannot enable" in refused.stderr
    assert cell.poll() is None


@pytest.mark.usefixtures("cell")
def test_a_topic_is_watched_without_a_ros_installation() -> None:
    listed, once, missing = together("watch", "watch current_pose --once --for 30", "watch nobody --for 1")
    assert "/controller/state  (seed_msgs/msg/ControllerState)" in listed.stdout
    assert once.returncode == 0, once.stderr
    assert once.stdout.count("/current_pose: message 1") == 1
    assert "frame_id: base" in once.stdout
    assert "orientation: roll pitch yaw " in once.stdout
    assert missing.returncode == 2
    assert "nobody publishes /nobody" in missing.stderr
