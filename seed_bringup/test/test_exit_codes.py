# SPDX-License-Identifier: Apache-2.0
"""One rule for every command: 2 when it is used wrongly, with one line that says how."""

import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from seed_bringup.command_table import Command
from seed_bringup.commands import dispatch
from seed_bringup.commands.dispatch import main

WRONG = [
    "dmeo",
    "demo --seed -1",
    "demo --force abc",
    "demo --task gone",
    "demo --scenario gone",
    "demo --scenario {junk}",
    "demo --out {junk}/below",
    "demo --out {full}",
    "demo robot:=kuka",
    "demo robot:=ur robot_ip:=10.0.0.1",
    "test seed_core/test/gone.py",
    "test -n 0 seed_core/test/test_config.py -k gone",
    "evaluate gone",
    "evaluate gone --scenarios 1",
    "evaluate squeegee --force nan",
    "evaluate squeegee --scenario gone.yaml",
    "evaluate squeegee --scenario {junk}",
    "evaluate squeegee --draws 2 --plot plot.png",
    "evaluate squeegee --scenarios 1 --plot {junk}/plot.png",
    "evaluate squeegee --plot {empty}/plot.txt",
    "validate estimator --scenario gone",
    "validate estimator --from gone",
    "validate estimator --from {junk}",
    "validate slip --minutes -1",
    "recordings --only press --press gone",
    "recordings --only infrared --infrared {junk}",
    "calibrate gone.npz",
    "calibrate {junk}",
    "calibrate {junk} --radius 12",
    "dataset",
    "identify --scenario gone",
    "identify --from gone",
    "identify --from {junk}",
    "identify --zero-sensor",
    "identify --procedure weight --out {empty}",
    "reproduce fig9",
    "reproduce fig6 --force -1 --out {empty}",
    "reproduce fig6 --out {junk}/below",
    "bench gone",
    "launch",
    "launch gone",
    "launch cell gone:=1",
    "launch {junk}",
    "launch cell scenario=pen",
    "launch cell scenario:=penn",
    "launch cell robot:=ur",
    "launch camera_host address:=203.0.113.251 peers:=203.0.113.252",
    "hand penn",
    "call controller/enable maybe",
    "call --namespace 1x",
    "watch --namespace 'a b'",
    "cancel --namespace left//right",
    "play squeegee --namespace left-hand",
    "view --namespace ~left",
    "foxglove --namespace /1x",
    "access {empty} --namespace 1x",
    "cancel --domain 233",
    "bag record --all --domain -1",
    "play gone",
    "play squeegee --force nan",
    "bag info gone",
    "bag play {junk}",
    "bag record",
    "bag record 1bad -o {full}/bag",
    "ur-sim --host 0.0.0.0",
    "ur-sim --version 4",
    "lint --gone",
    "launch --gone",
    "view --gone",
    "compare --gone",
]


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, str]]:
    """A file of nonsense, a folder with something in it and one without; arguments and signals as before afterwards."""
    monkeypatch.setattr(sys, "argv", sys.argv)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    (tmp_path / "junk.yaml").write_text("nonsense: [1, 2")
    (tmp_path / "a folder").mkdir()
    (tmp_path / "a folder" / "file").touch()
    (tmp_path / "empty").mkdir()
    yield {"junk": str(tmp_path / "junk.yaml"), "full": str(tmp_path / "a folder"), "empty": str(tmp_path / "empty")}
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("words", WRONG)
def test_wrong_use_exits_with_2_and_says_how(
    words: str, places: dict[str, str], capfd: pytest.CaptureFixture[str]
) -> None:
    arguments = shlex.split(words.format(**{name: shlex.quote(place) for name, place in places.items()}))
    try:
        code = main(arguments)
    except SystemExit as ended:  # argparse's own
        code = ended.code
    said = capfd.readouterr()
    assert code == 2, said.err
    assert "Traceback" not in said.err
    lines = said.err.strip().splitlines()
    longer = words.startswith("test ") or words.endswith("--scenario {junk}")  # pytest's own words; a place in YAML
    assert len(lines) == 1 or longer


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("launch cell foo", "seed launch: foo: no argument of cell: arguments have the form name:=value\n"),
        ("launch cel foo", "seed launch: package 'cel' is not installed here"),
        ("launch seed_bringup foo", "seed launch: package 'seed_bringup' has no launch file 'foo'"),
    ],
)
def test_a_word_behind_a_launch_file_is_no_package_s_file(
    words: str, said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    assert capfd.readouterr().err.startswith(said)


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("evalaute squeegee", "evaluate"),
        ("evaluate squeege", "squeegee"),
        ("evaluate squeegee --scenario nominl", "nominal"),
        ("play penn", "pen"),
        ("hand penn", "pen"),
        ("bench contrl", "control"),
        ("reproduce fig66", "fig6"),
        ("launch cel", "cell"),
    ],
)
def test_a_mistyped_name_is_told_with_what_was_meant(
    words: str, meant: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", sys.argv)
    try:
        code = main(words.split())
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    assert f"did you mean {meant}?" in capfd.readouterr().err


def test_bench_without_a_name_lists_what_there_is_and_runs_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench"]) == 0
    listed = capsys.readouterr().out
    assert "estimator, gel, control" in listed
    assert "./seed bench all" in listed


@pytest.mark.parametrize(
    ("missing", "remedy"),
    [
        (
            "seed_missing.command",
            "seed bench: needs the package seed_missing of this suite: colcon build",
        ),
        (
            "rtde_control",
            "seed bench: needs the Python package ur-rtde, which apt does not have: "
            "pip install -c requirements/common.txt ur-rtde, in a venv made with --system-site-packages\n",
        ),
    ],
)
def test_a_command_whose_package_is_missing_says_what_to_install(
    missing: str, remedy: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(dispatch, "offered", lambda **_: {"bench": Command("bench", missing, "")})
    monkeypatch.setitem(sys.modules, "rtde_control", None)  # as if it were not installed
    monkeypatch.setattr(sys, "argv", sys.argv)
    assert main(["bench"]) == 1
    assert capsys.readouterr().err.startswith(remedy)


def test_a_task_is_played_on_a_real_cell_without_the_simulator() -> None:
    words = "import sys; sys.modules['seed_sim'] = None; import seed_bringup.commands.play"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
