# SPDX-License-Identifier: Apache-2.0
"""Tests that start ROS nodes get a domain of their own, so that neighbours and other checkouts do not hear them."""

import contextlib
import fcntl
import functools
import importlib
import os
import random
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import pytest

NICE = 10  # of workers that compute: those that run against the clock go before them
LAST_DOMAIN = 101  # above it, DDS ports meet the ephemeral ones of Linux


def _claim_domain() -> tuple[int, IO[str] | None]:
    """A domain whose lock file this process holds for its lifetime."""
    folder = Path(tempfile.gettempdir()) / f"seed-domains-{os.getuid()}"  # as seed_bringup.launching.domains has it
    folder.mkdir(exist_ok=True)
    domains = random.sample(range(1, LAST_DOMAIN + 1), LAST_DOMAIN)
    for domain in domains:
        lock = (folder / str(domain)).open("a")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            continue
        return domain, lock
    return domains[0], None


_domain, _lock = _claim_domain()
os.environ["ROS_DOMAIN_ID"] = str(_domain)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
_profile = Path(__file__).parent / "seed_bringup/config/loopback_images.xml"  # room for images, and quick discovery
_fast_dds = "FASTRTPS" if os.environ.get("ROS_DISTRO", "jazzy") == "jazzy" else "FASTDDS"  # as parts/network.xml has it
os.environ[f"{_fast_dds}_DEFAULT_PROFILES_FILE"] = str(_profile)
os.environ.pop("SEED_LOOPBACK", None)  # the profile is not that of ./seed

# pytest names a test module by its path, seed_core/test/test_x.py by seed_core.test.test_x; the real package must
# be there first, or pytest takes the folder around it for the package.
for _folder in sorted(Path(__file__).parent.glob("seed_*/setup.py")):
    with contextlib.suppress(ImportError):
        importlib.import_module(_folder.parent.name)


@pytest.fixture
def bench() -> Iterator[Any]:
    """A context for nodes under test, with a client: seed_ros.testing.Bench."""
    from seed_ros.testing import Bench  # needs ROS, which most tests do not

    bench = Bench()
    try:
        yield bench
    finally:
        bench.close()


@functools.cache
def against_the_clock(file: Path) -> bool:
    """Whether a file has tests against the clock, by what it says: the process that hands out files sees no marks."""
    return "node" in file.stem.split("_") or "mark.realtime" in file.read_text(encoding="utf-8")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Each file goes to one worker, and all files with tests against the clock to the same one: they cannot overlap."""
    from xdist.scheduler import LoadFileScheduling

    class OneClock(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file: str = super()._split_scope(nodeid)
            return "the clock" if against_the_clock(config.rootpath / file) else file

    return OneClock(config, log) if config.getvalue("dist") == "loadfile" else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of nodes run against the clock, whether or not they say so.

    A neighbour on a shared machine can spoil a test against the clock; it is run again once the neighbour has
    had some seconds, and the summary says so.
    """
    for item in items:
        if "node" in item.path.stem.split("_"):
            item.add_marker(pytest.mark.realtime)
        if item.get_closest_marker("realtime") is not None:
            item.add_marker(pytest.mark.flaky(reruns=2, reruns_delay=10))


def _locks(run: str) -> list[Path]:
    """Files that the workers of one run lock: clock, gate and lock."""
    return [Path(tempfile.gettempdir()) / f"seed-test-run-{run}.{name}" for name in ("clock", "gate", "lock")]


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """With several workers, one test at a time runs against the clock, and none beside one that must be alone.

    Others share a lock that such a one holds for itself.
    """
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID")
    if run is None:
        return (yield)
    if not against_the_clock(item.path):  # the worker that runs against the clock does so first
        os.nice(max(NICE - os.nice(0), 0))
    realtime, alone = (item.get_closest_marker(name) is not None for name in ("realtime", "alone"))
    # Whoever waits for the machine stands in the gate, so that the others cannot overtake it for ever.
    with contextlib.ExitStack() as stack:
        clock, gate, lock = (stack.enter_context(file.open("w")) for file in _locks(run))
        if realtime and not alone:
            fcntl.flock(clock, fcntl.LOCK_EX)
        fcntl.flock(gate, fcntl.LOCK_EX)
        fcntl.flock(lock, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        fcntl.flock(gate, fcntl.LOCK_UN)
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_sessionfinish(session: pytest.Session) -> Iterator[None]:
    """The process that started the workers removes what they locked, once they have ended."""
    yield  # pytest-xdist ends its workers in here
    workers = getattr(session.config.pluginmanager.get_plugin("dsession"), "nodemanager", None)
    for file in _locks(workers.testrunuid) if workers is not None else ():
        file.unlink(missing_ok=True)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Why a test had to be run again."""
    for report in terminalreporter.stats.get("rerun", []):
        crash = getattr(report.longrepr, "reprcrash", None)
        terminalreporter.write_line(f"RERUN {report.nodeid}: {crash.message if crash else report.longreprtext}"[:1000])
