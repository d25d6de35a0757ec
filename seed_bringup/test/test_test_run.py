# SPDX-License-Identifier: Apache-2.0
"""What a test run leaves behind: nothing."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(not (ROOT / "conftest.py").is_file(), reason="an installed copy, not the checkout")
TESTS = """
import os, pathlib, tempfile

def test_the_locks_of_this_run_are_there():
    run = os.environ["PYTEST_XDIST_TESTRUNUID"]
    assert len(list(pathlib.Path(tempfile.gettempdir()).glob(f"seed-test-run-{run}.*"))) == 3

def test_another_run_goes_on():
    (pathlib.Path(tempfile.gettempdir()) / "seed-test-run-another.lock").touch()

def test_that_fails():
    assert False
"""


def test_a_run_removes_its_own_locks_and_those_of_no_other(tmp_path: Path) -> None:
    pytest.importorskip("xdist", reason="needs pytest-xdist (./seed test has it)")
    (tmp_path / "conftest.py").symlink_to(ROOT / "conftest.py")
    (tmp_path / "test_three.py").write_text(TESTS)
    (tmp_path / "tmp").mkdir()
    command = [sys.executable, "-P", "-m", "pytest", "-n", "2", "-q", "-p", "no:cacheprovider", "test_three.py"]
    environment = os.environ | {"TMPDIR": str(tmp_path / "tmp")}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert "1 failed, 2 passed" in done.stdout, done.stdout + done.stderr
    assert [f.name for f in (tmp_path / "tmp").glob("seed-test-run-*")] == ["seed-test-run-another.lock"]
