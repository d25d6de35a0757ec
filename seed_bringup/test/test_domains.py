# SPDX-License-Identifier: Apache-2.0
"""Each cell of a machine has a ROS domain of its own, and commands find the one that runs."""

import argparse
import math
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from seed_bringup.commands.cells import cell_arguments, in_root, join
from seed_bringup.commands.launch import joins
from seed_bringup.launching import domains
from seed_bringup.launching.description import describe
from seed_bringup.launching.packages import find_launch_file
from seed_core.errors import SeedError


@pytest.fixture(autouse=True)
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(domains, "folder", lambda: tmp_path)
    monkeypatch.setenv("ROS_DOMAIN_ID", "")


def here() -> str:
    return os.environ.get("ROS_DOMAIN_ID", "")


def joined(domain: int | None = None) -> str:
    join(argparse.Namespace(domain=domain, namespace=""))
    return here()


def test_a_command_says_which_cell_it_joins_and_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def words(domain: int | None = None) -> str:
        monkeypatch.setenv("ROS_DOMAIN_ID", "")
        return join(argparse.Namespace(domain=domain, namespace=""))

    assert words() == "ROS domain 0, the default: you run no cell on this machine"
    with domains.claimed(domains.OWN, "launch cell robot:=ur"):
        assert words() == "ROS domain 1, the only cell that you run on this machine (seed launch cell robot:=ur)"
        monkeypatch.setenv("ROS_DOMAIN_ID", "")
        with (
            domains.claimed(domains.OWN, "launch cell"),
            pytest.raises(SeedError, match="you run several cells"),
        ):
            words()
        assert words(1) == "ROS domain 1, as --domain says (seed launch cell robot:=ur)"
        assert words(5) == "ROS domain 5, as --domain says"
        monkeypatch.setenv("ROS_DOMAIN_ID", "1")
        told = join(argparse.Namespace(domain=None, namespace=""))
        assert told == "ROS domain 1, as ROS_DOMAIN_ID says (seed launch cell robot:=ur)"


@pytest.mark.parametrize(
    ("given", "absolute"),
    [("left", "/left"), ("/left", "/left"), ("left/", "/left"), ("/lab/left_2/", "/lab/left_2"), ("/", "/"), ("", "/")],
)
def test_a_namespace_is_the_same_with_and_without_slashes_at_its_ends(given: str, absolute: str) -> None:
    parser = argparse.ArgumentParser()
    cell_arguments(parser)
    assert in_root(parser.parse_args(["--namespace", given]).namespace) == absolute


def test_it_is_known_how_long_ago_a_cell_was_launched(tmp_path: Path) -> None:
    with domains.claimed(domains.OWN, "launch cell"):
        assert domains.age(1) < 10.0
        began = time.time() - 90.0
        os.utime(tmp_path / "1", (began, began))
        assert domains.age(1) == pytest.approx(90.0, abs=5.0)
        assert domains.age(2) == math.inf
    assert domains.age(1) == math.inf


def test_two_cells_take_two_domains_and_give_them_back() -> None:
    with domains.claimed(domains.SHARED, "launch cell") as first:
        assert (first, here()) == (0, "0")
        os.environ["ROS_DOMAIN_ID"] = ""
        with domains.claimed(domains.SHARED, "launch cell seed:=3") as second:
            assert (second, here()) == (1, "1")
            assert domains.running() == {0: ["launch cell"], 1: ["launch cell seed:=3"]}
        assert domains.running() == {0: ["launch cell"]}
    assert domains.running() == {}


def test_a_cell_keeps_clear_of_those_of_other_users_and_commands_do_not_find_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine, hers = tmp_path / f"{domains.FOLDERS}1", tmp_path / f"{domains.FOLDERS}2"
    mine.mkdir()
    hers.mkdir()
    monkeypatch.setattr(domains, "folder", lambda: hers)
    with domains.claimed(domains.SHARED, "launch cell"):
        monkeypatch.setattr(domains, "folder", lambda: mine)
        monkeypatch.setenv("ROS_DOMAIN_ID", "")
        with domains.claimed(domains.SHARED, "launch cell") as domain:
            assert domain == 1
            assert domains.running() == {1: ["launch cell"]}
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    with domains.claimed(domains.SHARED, "launch cell") as domain:
        assert domain == 0  # hers has ended


def test_a_domain_that_is_named_is_taken_though_another_cell_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    with domains.claimed(domains.OWN, "demo") as first, domains.claimed(domains.OWN, "demo") as second:
        assert first == second == 7
        assert domains.running() == {7: ["demo", "demo"]}
    assert here() == "7"


def test_a_second_cell_of_a_domain_is_found_when_the_first_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "1")
    first = domains.claimed(domains.OWN, "launch cell namespace:=left")
    first.__enter__()
    with domains.claimed(domains.OWN, "launch cell namespace:=right"):
        monkeypatch.setenv("ROS_DOMAIN_ID", "")
        both = "(seed launch cell namespace:=left, seed launch cell namespace:=right)"
        told = join(argparse.Namespace(domain=None, namespace=""))
        assert told == f"ROS domain 1, the only one in which you run cells on this machine {both}"
        first.__exit__(None, None, None)
        monkeypatch.setenv("ROS_DOMAIN_ID", "")
        assert joined() == "1"
        monkeypatch.setenv("ROS_DOMAIN_ID", "")
        assert domains.age(1) < 10.0
        with domains.claimed(domains.OWN, "demo") as other:
            assert other == 2
    assert domains.running() == {}


def test_of_a_domain_that_a_test_has_no_cell_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    with domains.claimed(domains.OWN, ""), domains.claimed(domains.OWN, "launch cell"):
        assert domains.running() == {}
        assert [f.name for f in tmp_path.iterdir()] == ["7"]


@pytest.mark.parametrize(("namespace", "warned"), [("left", True), ("right", False), ("", False)])
def test_cells_that_hear_each_other_are_warned_of(
    namespace: str, warned: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, file = tmp_path / f"{domains.FOLDERS}{os.getuid()}", tmp_path / "empty.xml"
    place.mkdir()
    file.write_text('<launch><arg name="namespace" default=""/></launch>')
    monkeypatch.setattr(domains, "folder", lambda: place)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    words = ["launch", "--own", str(file), f"namespace:={namespace}"]
    with domains.claimed(domains.OWN, "launch cell namespace:=/left"):
        command = [sys.executable, "-m", "seed_bringup.commands.dispatch", *words]
        said = subprocess.run(command, capture_output=True, text=True, timeout=60.0).stdout
    assert "in ROS domain 7" in said
    assert ("they hear each other. If that is not meant" in said) is warned


@pytest.mark.parametrize(
    ("words", "other", "joined"),
    [
        ("seed_sysid identify_launch.xml robot:=real", "launch cell robot:=ur robot_ip:=192.0.2.1", True),
        ("perception", "launch seed_driver driver_launch.xml robot_ip:=192.0.2.1", True),
        ("seed_driver driver_launch.xml robot_ip:=192.0.2.1", "launch perception", True),
        ("perception", "launch cell", False),  # which has an estimator
        ("perception", "launch cell method:=elsewhere", True),
        ("seed_sysid identify_launch.xml", "launch cell", False),  # two arms
        ("cell", "launch cell", False),
        ("cell", "demo", False),
        ("cell", "launch gone.xml", False),
    ],
)
def test_a_launch_that_completes_another_is_not_warned_of(words: str, other: str, joined: bool) -> None:
    pytest.importorskip("ament_index_python", reason="the workspace is not built (./seed test does it)")
    given = dict(w.split(":=") for w in words.split() if ":=" in w)
    file = find_launch_file([w for w in words.split() if ":=" not in w])
    assert joins(describe(file, given), other) is joined


def test_a_cell_that_is_killed_leaves_its_domain(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from seed_bringup.launching import domains\n"
        f"domains.folder = lambda: Path({str(tmp_path)!r})\n"
        "with domains.claimed(domains.SHARED, 'launch cell'): print('up', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as cell:
        assert cell.stdout is not None
        assert cell.stdout.readline() == b"up\n"
        assert domains.running() == {0: ["launch cell"]}
        assert joined() == "0"
        cell.kill()
    assert domains.running() == {}


def test_a_command_joins_the_cell_that_runs_or_asks_which() -> None:
    assert joined() == ""  # none: ROS's own default
    with domains.claimed(domains.OWN, "demo --seed 3"):
        os.environ["ROS_DOMAIN_ID"] = ""
        assert joined() == "1"
        os.environ["ROS_DOMAIN_ID"] = ""
        with domains.claimed(domains.SHARED, "launch cell"):
            os.environ["ROS_DOMAIN_ID"] = ""
            with pytest.raises(SeedError, match="say which: --domain 0: seed launch cell; --domain 1: seed demo"):
                joined()
            assert joined(domain=1) == "1"
