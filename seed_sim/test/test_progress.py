# SPDX-License-Identifier: Apache-2.0
"""Work on several cores: it comes in order, is counted, and Ctrl-C ends it with one line and nothing left behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from joblib import delayed

from seed_sim.closed_loop.progress import counted, in_parallel, progress_bar

SWEEP = """
import sys, time
from joblib import delayed
from seed_core.program.command_line import command
from seed_sim.closed_loop.progress import in_parallel

@command("seed sweep")
def main(argv):
    print("it begins", flush=True)
    list(in_parallel([delayed(time.sleep)(60.0)] * 4, 2, "run"))

sys.exit(main([]))
"""

LEFT_BEHIND = """
from joblib import delayed
from joblib.externals.loky.backend import resource_tracker
from seed_sim.closed_loop.progress import in_parallel

list(in_parallel([delayed(int)()] * 2, 2, "run"))
resource_tracker.register("/of-nobody", "semlock")  # as where Ctrl-C comes between its end and the word of it
"""


def test_results_come_in_the_order_of_the_calls() -> None:
    assert list(in_parallel([delayed(divmod)(i, 3) for i in range(5)], 1, "run")) == [divmod(i, 3) for i in range(5)]


def test_without_a_terminal_a_line_tells_how_much_is_done(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter((0.0, 6.0, 12.0, 18.0, 24.0))
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    assert list(counted("abcd", 4, "draw")) == list("abcd")
    assert capsys.readouterr().err == "2 of 4 draws, about 12 s left\n"


@pytest.mark.parametrize("after", [0.3, 3.0])  # [s]: the processes still import; they work
def test_ctrl_c_ends_all_processes_and_one_of_them_tells(after: float, tmp_path: Path) -> None:
    (tmp_path / "sweep.py").write_text(SWEEP)
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "sweep.py")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(after)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        _, said = process.communicate(timeout=20.0)
    assert (process.returncode, said) == (130, "seed sweep: interrupted\n")
    deadline = time.monotonic() + 5.0
    while subprocess.run(["pgrep", "-g", str(process.pid)], stdout=subprocess.DEVNULL).returncode == 0:
        assert time.monotonic() < deadline, "processes are left"
        time.sleep(0.1)


def test_what_an_interrupted_pool_leaves_behind_is_no_warning(tmp_path: Path) -> None:
    (tmp_path / "left.py").write_text(LEFT_BEHIND)
    ran = subprocess.run([sys.executable, str(tmp_path / "left.py")], capture_output=True, text=True, timeout=60.0)
    assert (ran.returncode, ran.stderr) == (0, "")


def test_nothing_is_shown_where_it_is_not_wanted_or_there_is_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for terminal, shown in ((True, False), (False, True)):
        monkeypatch.setattr(sys.stderr, "isatty", lambda terminal=terminal: terminal)
        with progress_bar("draw 7", shown=shown) as move:
            move(0.5, "wipe")
            move(0.0, "lift")
    assert capsys.readouterr().err == ""


def test_the_time_left_is_that_of_the_stretch(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 0.0
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr("tqdm.std.time", lambda: now)
    with progress_bar("draw 7", leave=False) as move:
        for now, share, phase in (  # noqa: B007
            (0.0, 0.0, "calibrate"),
            (600.0, 0.0, "identify"),
            (610.0, 0.5, "identify"),
            (700.0, 0.0, "start"),
            (704.0, 0.2, "wipe"),
        ):
            move(share, phase)
    said = capsys.readouterr().err
    assert "50%" in said
    assert "00:10 left, identify" in said
    assert "00:16 left, wipe" in said


def test_a_bar_tells_the_time_left(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress_bar("fig7") as move:
        time.sleep(0.02)
        move(0.5, "wipe")
    assert "00:00 left, wipe" in capsys.readouterr().err
