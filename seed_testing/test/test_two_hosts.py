# SPDX-License-Identifier: Apache-2.0
"""The bad network of `./seed bench hosts`, and what its table calls wrong."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from seed_testing.two_hosts import command, network
from seed_testing.two_hosts.command import CASES, line, of_method, wrong
from seed_testing.two_hosts.network import ADDRESSES, Quality, TwoHosts, Way

ROW = {"age_ms": 64.1, "age_p99_ms": 133.0, "skew_ms": "0.1", "within_ms": "3.8", "ended": "", "force_rms_n": 0.05}
ROW |= {"force_max_n": 10.2}
CASE = {c.name: c for c in CASES}


def test_packets_are_late_as_asked_and_keep_their_order() -> None:
    way, quality = Way(3), Quality(0.01, 0.005)
    sent = np.arange(0.0, 10.0, 0.01)
    for i, t in enumerate(sent):
        way.put(str(i).encode(), t, quality)
    came: list[tuple[float, int]] = []
    while way.next < np.inf:
        came += [(at, int(packet)) for at in [way.next] for packet in way.take(at)]
    assert [number for _, number in came] == list(range(len(sent)))
    late = np.array([at for at, _ in came]) - sent
    assert late.min() >= 0.0
    assert 0.009 < np.median(late) < 0.012
    assert 0.003 < late.std() < 0.006


@pytest.mark.parametrize(
    ("loss", "cut", "low", "high"), [(0.05, False, 0.03, 0.07), (0.0, True, 1.0, 1.0), (0.0, False, 0.0, 0.0)]
)
def test_packets_are_lost_as_asked(loss: float, cut: bool, low: float, high: float) -> None:
    way = Way(1)
    for i in range(2000):
        way.put(b"", 0.001 * i, Quality(0.0, 0.0, loss, cut))
    assert low <= way.lost / 2000 <= high
    assert len(way.take(10.0)) == 2000 - way.lost


def test_the_table_tells_what_is_not_as_it_should_be() -> None:
    assert wrong(CASE["2 ms"], ROW) == ""
    assert wrong(CASE["2 ms"], {}) == "not run"
    assert wrong(CASE["2 ms"], ROW | {"ended": "arm holds"}) == "arm holds"
    assert "measured as 0.1 +- 3.8 ms" in wrong(CASE["2 ms, clock +5 ms"], ROW)
    assert wrong(CASE["2 ms, clock +50 ms"], ROW) == "a clock that is off was accepted"
    cut = ROW | {"ended": "arm holds", "hold": "stale", "enable_while_cut": "stale", "enabled_after_s": 0.2}
    cut |= {"held_after_s": 0.18, "travel_mm": 7.3, "blind_s": 0.02}
    assert wrong(CASE["2 ms, cut"], cut) == ""
    assert wrong(CASE["2 ms, cut"], cut | {"enable_while_cut": "granted"}) == "enabled without estimates"
    assert wrong(CASE["2 ms, cut"], cut | {"enabled_after_s": "not within 20 s"}) == "no cause, or no way back"
    assert "held 0.18 s after the cut (7.3 mm): stale" in line(CASE["2 ms, cut"], cut)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"held_after_s": 1.45}, "stood after 1.45 s, at most 0.3 s"),
        ({"held_after_s": None}, "stood after None s"),
        ({"held_after_s": float("nan")}, "stood after nan s"),
        ({"blind_s": 1.2}, "not seen for 1.2 s, at most 0.2 s"),
        ({"travel_mm": 80.0}, "went on by 80.0 mm, at most 15 mm"),
        ({"force_max_n": 40.0}, "true force 40.0 N, at most 15 N"),
    ],
)
def test_an_arm_that_goes_on_after_a_cut_is_wrong(changed: dict[str, float | None], why: str) -> None:
    cut = ROW | {"ended": "arm holds", "hold": "stale", "enable_while_cut": "stale", "enabled_after_s": 0.2}
    cut |= {"held_after_s": 0.18, "travel_mm": 7.3, "blind_s": 0.02}
    assert wrong(CASE["2 ms, cut"], cut | changed).startswith(why)


def test_a_row_counts_for_the_method_that_it_was_made_with() -> None:
    rows = {"2 ms": ROW | {"method": "truth"}, "10 ms": ROW}
    assert of_method(rows, CASE["2 ms"], "truth") == rows["2 ms"]
    assert of_method(rows, CASE["2 ms"], "rigid_fit") == {}
    assert of_method(rows, CASE["10 ms"], "rigid_fit") == {}  # nobody knows


class _AskedError(Exception):
    """In place of a process that would be started."""


@pytest.mark.parametrize(
    ("distribution", "variable"),
    [("jazzy", "FASTRTPS_DEFAULT_PROFILES_FILE"), ("kilted", "FASTDDS_DEFAULT_PROFILES_FILE")],
)
def test_its_processes_and_the_cameras_bench_have_their_profile_by_the_name_that_their_fast_dds_reads(
    monkeypatch: pytest.MonkeyPatch, distribution: str, variable: str
) -> None:
    pytest.importorskip("rclpy", reason="needs ROS 2")
    from seed_testing.bench.ros import camera_rate

    given: list[dict[str, str]] = []

    def start(*_: object, env: dict[str, str], **__: object) -> None:
        given.append(env)
        raise _AskedError

    monkeypatch.setenv("ROS_DISTRO", distribution)
    monkeypatch.setattr(subprocess, "Popen", start)
    monkeypatch.setattr(TwoHosts, "inside", lambda *_: [])
    with pytest.raises(_AskedError):
        command._host(TwoHosts(), 0, "camera_host", *ADDRESSES).__enter__()
    with pytest.raises(_AskedError):
        camera_rate.run()
    names = [Path(environment[variable]) for environment in given]
    assert [name.name for name in names] == ["hosts.xml", "loopback_images.xml"]
    assert all(name.is_file() for name in names)


def test_without_the_rights_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert "rights of root" in network.why_not()


ANSWER = """
import socket, sys, time
here = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
here.bind((sys.argv[1], 5000))
print("ready", flush=True)
words, sender = here.recvfrom(100)
here.sendto(words, sender)
"""
ASK = """
import socket, sys, time
here = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
here.settimeout(5.0)
began = time.monotonic()
here.sendto(b"what time is it", (sys.argv[1], 5000))
assert here.recv(100) == b"what time is it"
print(time.monotonic() - began)
"""


@pytest.mark.skipif(bool(network.why_not()), reason=network.why_not() or "it can")
def test_two_computers_reach_each_other_over_the_slow_link_alone() -> None:
    try:
        hosts = TwoHosts().__enter__()
    except Exception as error:  # in a container without the right to make namespaces
        pytest.skip(str(error))
    try:
        hosts.quality = Quality(0.05)
        answers = hosts.inside(0, [sys.executable, "-c", ANSWER, ADDRESSES[0]])
        with subprocess.Popen(answers, stdout=subprocess.PIPE, text=True) as answering:
            assert answering.stdout is not None
            assert answering.stdout.readline() == "ready\n"
            asks = hosts.inside(1, [sys.executable, "-c", ASK, ADDRESSES[0]])
            took = float(subprocess.run(asks, capture_output=True, text=True, check=True).stdout)
        assert 0.1 <= took < 3.0
    finally:
        hosts.__exit__()
