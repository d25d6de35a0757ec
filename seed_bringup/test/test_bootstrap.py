# SPDX-License-Identifier: Apache-2.0
"""The set-up behind ./seed, on folders made for the purpose; the real thing runs before every test."""

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parents[2]
BOOTSTRAP = ROOT / "tools" / "bootstrap"
pytestmark = pytest.mark.skipif(not BOOTSTRAP.is_dir(), reason="this is an installed copy, not the checkout")


@pytest.fixture
def load(monkeypatch: pytest.MonkeyPatch) -> object:
    """Import a module of the bootstrap, whose folder is on the path only there."""
    monkeypatch.syspath_prepend(str(BOOTSTRAP))
    return importlib.import_module


def make_ros(prefix: Path, python: str = "python3.12") -> Path:
    """What identifies an installed ROS 2."""
    (prefix / "lib" / python / "site-packages" / "rclpy").mkdir(parents=True)
    (prefix / "setup.bash").write_text(f"export AMENT_PREFIX_PATH={prefix} ROS_DISTRO={prefix.name}\n")
    return prefix


def test_sourced_ros_comes_before_the_wheels_and_a_too_old_one_does_not(
    load: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ros: ModuleType = load("ros")  # type: ignore[operator]
    monkeypatch.delenv("SEED_ROS", raising=False)
    monkeypatch.setattr(ros, "INSTALLED", ())
    jazzy, humble = make_ros(tmp_path / "jazzy"), make_ros(tmp_path / "humble", "python3.10")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'overlay'}:{jazzy}")
    found = ros.find_ros()
    assert (found.kind, found.python, found.underlays) == ("jazzy", (3, 12), (f"{tmp_path / 'overlay'}", str(jazzy)))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(humble))
    assert ros.find_ros() == ros.WHEELS
    monkeypatch.setenv("SEED_ROS", str(jazzy))
    assert ros.find_ros().prefix == jazzy
    monkeypatch.setenv("SEED_ROS", "wheels")
    assert ros.find_ros() == ros.WHEELS
    monkeypatch.setenv("SEED_ROS", str(tmp_path / "nothing"))
    with pytest.raises(Exception, match="no ROS 2 with setup\\.bash and rclpy there"):
        ros.find_ros()


def test_wheels_do_not_see_the_paths_of_another_ros(load: object, monkeypatch: pytest.MonkeyPatch) -> None:
    ros: ModuleType = load("ros")  # type: ignore[operator]
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/home/me/ws/install/cell:/opt/ros/humble")
    assert ros.foreign("/opt/ros/humble/lib/python3.10/site-packages")
    assert ros.foreign("/home/me/ws/install/cell/lib")
    assert not ros.foreign("/usr/lib/python3/dist-packages")


def test_home_is_writable_and_free_of_white_space(
    load: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home: ModuleType = load("home")  # type: ignore[operator]
    monkeypatch.setenv("SEED_HOME", str(tmp_path / "kept here"))
    with pytest.raises(Exception, match="writable folder without white space"):
        home.seed_home()
    monkeypatch.setenv("SEED_HOME", str(tmp_path / "kept"))
    assert home.seed_home() == tmp_path / "kept"
    monkeypatch.delenv("SEED_HOME")
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    fallback = home.seed_home()
    assert fallback.is_relative_to("/var/tmp")


def test_only_changes_that_a_build_reads_make_a_package_build_again(load: object, tmp_path: Path) -> None:
    workspace: ModuleType = load("workspace")  # type: ignore[operator]
    package = tmp_path / "seed_x"
    (package / "seed_x").mkdir(parents=True)
    (package / "launch").mkdir()
    (package / "package.xml").write_text("<package/>")
    (package / "seed_x" / "core.py").write_text("A = 1")
    (package / "launch" / "a.xml").write_text("<launch/>")
    before = workspace._digest(package)
    (package / "seed_x" / "core.py").write_text("A = 2")
    (package / "seed_x" / "new.py").write_text("B = 1")
    (package / "launch" / "a.xml").write_text("<launch></launch>")
    assert workspace._digest(package) == before, "sources are linked, not copied"
    (package / "launch" / "b.xml").write_text("<launch/>")
    with_file = workspace._digest(package)
    assert with_file != before, "a new launch file has to be installed"
    (package / "package.xml").write_text("<package format='3'/>")
    assert workspace._digest(package) != with_file


@pytest.mark.parametrize("distribution", ["jazzy", "kilted"])
def test_ros_is_bound_to_this_computer_unless_the_caller_says_otherwise(
    load: object, monkeypatch: pytest.MonkeyPatch, distribution: str
) -> None:
    workspace: ModuleType = load("workspace")  # type: ignore[operator]
    profile = workspace.PROFILE if distribution == "jazzy" else workspace.PROFILE_3
    names = reach, profile, by_seed = "ROS_AUTOMATIC_DISCOVERY_RANGE", profile, workspace.BY_SEED
    environment = SimpleNamespace(path=Path("/env"), pins="wheels", ros=SimpleNamespace(prefix=None, underlays=[]))
    bound = str(ROOT / "seed_bringup/config/loopback.xml")

    def started(**given: str) -> tuple[str | None, ...]:
        for name in names:
            monkeypatch.delenv(name, raising=False)
        for name, value in given.items():
            monkeypatch.setenv(name, value)
        merged = workspace._merged({"ROS_DISTRO": distribution}, ROOT, environment)
        return tuple(merged.get(name) for name in names)

    other = {workspace.PROFILE, workspace.PROFILE_3} - {profile}
    monkeypatch.delenv(*other, raising=False)
    assert other.isdisjoint(workspace._merged({"ROS_DISTRO": distribution}, ROOT, environment))
    assert Path(bound).is_file()
    assert started() == ("LOCALHOST", bound, "true")
    assert started(**{reach: "SUBNET"}) == ("SUBNET", None, None)
    assert started(**{profile: "mine.xml"}) == ("LOCALHOST", "mine.xml", None)
    within = {profile: bound, by_seed: "true"}
    assert started(**within, **{reach: "LOCALHOST"}) == ("LOCALHOST", bound, "true")
    assert started(**within, **{reach: "SUBNET"}) == ("SUBNET", None, None)
    assert started(**{by_seed: "true", profile: "mine.xml"}) == ("LOCALHOST", "mine.xml", None)


def test_missing_tools_are_named_in_one_line_to_paste(
    load: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    system: ModuleType = load("system")  # type: ignore[operator]
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with pytest.raises(Exception, match=r"sudo apt-get update && sudo apt-get install -y cmake g\+\+ gcc make"):
        system.require_system_packages(Path(sys.executable))


def test_a_browser_is_installed_for_root_alone_and_its_lack_stops_nothing(
    load: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    system: ModuleType = load("system")  # type: ignore[operator]
    calls, apt = tmp_path / "calls", tmp_path / "bin" / "apt-get"
    apt.parent.mkdir()
    apt.write_text(f'#!/bin/sh\necho "$@" >> {calls}\nexit 100\n')
    apt.chmod(0o755)
    monkeypatch.setenv("PATH", str(apt.parent))
    for user, wish in ((1000, ""), (0, "none")):
        monkeypatch.setattr(os, "geteuid", lambda user=user: user)
        monkeypatch.setenv("SEED_BROWSER", wish)
        system.offer_browser()
    assert not calls.exists()
    monkeypatch.setenv("SEED_BROWSER", "")
    system.offer_browser()
    assert calls.read_text() == "-q update\n"
    assert "the tests of the page in a browser are skipped" in capsys.readouterr().err
    (apt.parent / "chromium").touch(mode=0o755)
    system.offer_browser()
    assert calls.read_text() == "-q update\n"


def test_failed_command_shows_the_end_of_its_log(load: object, tmp_path: Path) -> None:
    progress: ModuleType = load("progress")  # type: ignore[operator]
    command = ["sh", "-c", "seq 100; echo the disk is full; exit 3"]
    failed = pytest.raises(progress.SetupError, match=r"(?s)installing: failed with exit code 3.*the disk is full")
    with failed, (tmp_path / "lock").open("w") as lock:
        progress.run_logged(command, "installing", tmp_path / "log", dict(os.environ), lambda line: line, lock.fileno())
    assert (tmp_path / "log").read_text().startswith("1\n2\n")


def test_a_build_tells_which_package_of_how_many_in_place_of_the_compilers_lines(load: object) -> None:
    workspace: ModuleType = load("workspace")  # type: ignore[operator]
    told = workspace.Packages(12).told
    assert told("Topological order") == ""
    assert told("Starting >>> seed_core") == "package 1 of 12: seed_core"
    assert told("running egg_info") == "package 1 of 12: seed_core"
    assert told("Finished <<< seed_core [5.79s]") == ""
    assert told("Starting >>> seed_msgs") == "package 2 of 12: seed_msgs"
    assert told("[ 43%] Building CXX object CMakeFiles/x.cpp.o") == "package 2 of 12: seed_msgs, 43 %"
    assert told("[100%] Built target seed_msgs") == "package 2 of 12: seed_msgs, 100 %"
    assert told("Starting >>> tf2_msgs") == "package 3 of 12: seed_msgs, tf2_msgs"
    assert told("[ 12%] Building C object y.c.o") == "package 3 of 12: seed_msgs, tf2_msgs"
    assert told("Failed   <<< seed_msgs [9.00s, exited with code 2]") == "package 3 of 12: tf2_msgs"


def test_a_mistyped_command_is_told_what_was_meant_without_any_set_up() -> None:
    done = subprocess.run([ROOT / "seed", "evalaute"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith("; did you mean evaluate?\n")
    assert done.stderr.startswith("seed: no command 'evalaute'; there are: demo, ")


def test_second_set_up_waits_for_the_first(load: object, tmp_path: Path) -> None:
    """The lock is held by the first one's children too, should it be killed."""
    code = (
        f"import sys, subprocess; sys.path.insert(0, {str(BOOTSTRAP)!r}); import home, pathlib;"
        f"lock = home.locked(pathlib.Path({str(tmp_path / 'lock')!r}), 'x'); d = lock.__enter__();"
        "subprocess.Popen(['sleep', '1.5'], pass_fds=(d,)); print('held', flush=True); import os; os._exit(9)"
    )
    first = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert first.stdout is not None
    assert first.stdout.readline() == "held\n"
    started = time.monotonic()
    assert first.wait() == 9
    home: ModuleType = load("home")  # type: ignore[operator]
    with home.locked(tmp_path / "lock", "x"):
        assert time.monotonic() - started > 0.8


def test_second_start_runs_the_command_in_the_same_environment() -> None:
    command = [ROOT / "seed", "shell", "-c", 'echo "$VIRTUAL_ENV"; python -c "import rclpy, seed_core"']
    done = subprocess.run(command, capture_output=True, text=True, cwd="/", env=os.environ | {"SHELL": "/bin/sh"})
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == os.environ["VIRTUAL_ENV"]


def test_what_is_unused_is_named_and_what_is_in_use_is_not(
    load: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unused: ModuleType = load("unused")  # type: ignore[operator]
    for name in ("env-wheels-wheels-new", "env-wheels-wheels-old", "env-wheels-apt-other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "seed-complete").touch()
    builds = {"ws-1": (ROOT, "old"), "ws-2": (ROOT, "new"), "ws-3": (tmp_path / "gone", "new")}
    for name, (checkout, env) in builds.items():
        (tmp_path / name).mkdir()
        variables = {"VIRTUAL_ENV": str(tmp_path / f"env-wheels-wheels-{env}")}
        (tmp_path / name / "stamp.json").write_text(json.dumps({"checkout": str(checkout), "variables": variables}))
    unused.name_unused(tmp_path, tmp_path / "env-wheels-wheels-new", ROOT)
    assert capsys.readouterr().err == (
        f"seed: 4 old folders are used no longer; to free their space: rm -r $(cat {tmp_path / 'unused'})\n"
    )
    assert {Path(n).name for n in (tmp_path / "unused").read_text().split()} == {
        "ws-1",
        "ws-3",
        "env-wheels-wheels-old",
        "env-wheels-apt-other",
    }


def test_ctrl_c_ends_a_command_that_is_still_importing(tmp_path: Path) -> None:
    """The libraries of a command take seconds, and some of them swallow every exception."""
    (tmp_path / "slow.py").write_text(
        "import time\ntry:\n    print(0, flush=True)\n    for _ in range(600):\n        time.sleep(0.1)\n"
        "except BaseException:\n    time.sleep(60)\n"  # in short naps: one that has just begun is not interrupted
    )
    code = (
        f"import sys; sys.path[:0] = [{str(tmp_path)!r}]; from seed_bringup.commands import dispatch;"
        "from seed_bringup.command_table import Command;"
        "dispatch.offered = lambda checkout: {'demo': Command('demo', 'slow', '')}; dispatch.main(['demo'])"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"0\n"
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=20.0)
    assert process.returncode == 130
    assert said.decode().strip() == "seed demo: interrupted"


def test_ctrl_c_before_the_command_has_begun_waits_for_it() -> None:
    """As tools/bootstrap starts it; for importing NumPy takes a second on a busy machine, and nobody answers then."""

    def before() -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        os.kill(os.getpid(), signal.SIGINT)

    command = [sys.executable, "-P", "-m", "seed_bringup.commands.dispatch", "evaluate", "squeegee"]
    done = subprocess.run(command, preexec_fn=before, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "seed evaluate: interrupted\n")
