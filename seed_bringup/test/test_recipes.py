# SPDX-License-Identifier: Apache-2.0
"""What docs/architecture.md tells to write for a law or an estimator of one's own is enough for all that name them."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(not (ROOT / "seed").is_file(), reason="this is an installed copy, not the checkout")

LAW = """
from seed_bringup.commands.demo import _parser
from seed_control import LAWS, Controller, ControllerParameters
from seed_control.law.published import PublishedLaw
from seed_core import Hand, Stiffness, Tool
from seed_sim.closed_loop import command, evaluate
controller = Controller(ControllerParameters(law="mine"), Hand(), Tool(), Stiffness((4.0,) * 3, (800.0,) * 3))
assert type(controller.law) is PublishedLaw
assert "mine" in LAWS and "mine" in evaluate.LAWS
assert _parser().parse_args(["--law", "mine"]).law == "mine"
"""
METHOD = """
from seed_bringup.commands.demo import _parser
from seed_estimation import METHODS, EstimatorParameters
from seed_estimation.estimator import PATCH_METHODS
from seed_sim.closed_loop.relative_poses import ESTIMATORS
from seed_testing.validation.command import _parser as validate
assert EstimatorParameters(method="mine").method == "mine"
assert "mine" in METHODS and "mine" in PATCH_METHODS and "mine" in ESTIMATORS
assert _parser().parse_args(["--estimator", "mine"]).estimator == "mine"
assert validate().parse_args(["estimator", "--method", "mine"]).method == "mine"
"""


@pytest.mark.parametrize(
    ("package", "names", "classes", "script"),
    [
        ("seed_control", "LAWS = (", "controller.py: LAW_CLASSES: dict[str, type[PublishedLaw]] = {", LAW),
        ("seed_estimation", "METHODS = (", "estimator.py: PATCH_METHODS: dict[str, type[PublishedMethod]] = {", METHOD),
    ],
    ids=["law", "method"],
)
def test_one_s_own_law_or_method_is_found_everywhere(
    package: str, names: str, classes: str, script: str, tmp_path: Path
) -> None:
    """A copy of the package with two lines extended, as the recipe says."""
    shutil.copytree(ROOT / package / package, tmp_path / package)
    file, table = classes.split(": ", 1)
    published = table.split("[")[-1].split("]")[0]
    for name, before, more in (("parameters.py", names, '"mine", '), (file, table, f'"mine": {published}, ')):
        path = tmp_path / package / name
        text = path.read_text()
        assert text.count(f"\n{before}") == 1, f"{name} has no {before}"
        path.write_text(text.replace(f"\n{before}", f"\n{before}{more}"))
    path = os.pathsep.join((str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])))
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": path},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
