# SPDX-License-Identifier: Apache-2.0
"""The examples run as they stand, with the cores alone, and stay short enough to be read."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
pytestmark = pytest.mark.skipif(not EXAMPLES.is_dir(), reason="this is an installed copy, not the checkout")
# What each prints, in part; together they are all that there are.
PRINTS = {
    "stiffness_map": "10 N along z need the gripper 12.5 mm further along z",
    "estimate_pose": "pose of the tool in the gripper, from images of (171, 224) pixels",
    "controller": "contact: 10.0 N on the table, 10.0 N by the estimate",
    "closed_loop": "squeegee: finished",
    "new_task": "polish: finished; force -",
    "learning": "seed 2: wiped after",
}
WITHOUT_ROS = """
import runpy, sys
class NoRos:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("rclpy", "seed_ros", "seed_msgs"):
            raise ImportError(f"{name} is imported, but a core needs no ROS")
sys.meta_path.insert(0, NoRos())
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.mark.parametrize("name", PRINTS)
def test_an_example_runs_without_ros(name: str, tmp_path: Path) -> None:
    command = [sys.executable, "-c", WITHOUT_ROS, str(EXAMPLES / f"{name}.py")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert PRINTS[name] in done.stdout
    assert [f.name for f in tmp_path.iterdir()] == (["closed_loop.png"] if name == "closed_loop" else [])


def test_the_readme_s_python_runs(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (EXAMPLES.parent / "README.md").read_text(), re.DOTALL)
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["[", "0.", "0.", "10.]"]


def test_the_python_of_the_page_on_learning_runs(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (EXAMPLES.parent / "docs/learning.md").read_text(), re.DOTALL)
    command = [sys.executable, "-c", f"{code}\nprint(env.render().shape)"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[-2] == "(240, 480, 3)"


def test_examples_are_listed_short_and_explained() -> None:
    files = {f.stem: f.read_text() for f in EXAMPLES.glob("*.py")}
    assert set(files) == set(PRINTS)
    for name, text in files.items():
        assert len(text.splitlines()) < 60, name
        assert "pip install" in text, name
