# SPDX-License-Identifier: Apache-2.0
"""Which model the wrench comes from: chosen by name, from a file of this hand, or refused in words."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import Bench

from seed_control.wrench.model_settings import WrenchSettings, age, choose_model
from seed_core.config import ConfigError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Hand
from seed_core.spatial import Wrench, make_pose
from seed_core.stiffness_file import Grip, StiffnessFile, save_stiffness
from seed_core.wrench_model import BushingModel, SpringWrench

GRIP = Grip(
    1030.0,
    0.02,
    DEFAULT_STIFFNESS.rotation,
    DEFAULT_STIFFNESS.translation,
    rotation_std=(0.04, 0.03, 0.04),
    translation_std=(8.0, 12.0, 24.0),
)
FILE = StiffnessFile(Hand().name, "squeegee", "2026-01-31", (GRIP,))
LATER = datetime(2026, 3, 8, tzinfo=UTC)  # 36 days


def written(folder: Path, file: StiffnessFile) -> str:
    save_stiffness(folder / "stiffness.yaml", file)
    return str(folder / "stiffness.yaml")


def test_a_stiffness_file_tells_deviations_age_and_pressures(tmp_path: Path) -> None:
    """8 N along z: 3 % by the identification, 5 % of residual, and 6 % by 36 days."""
    settings = WrenchSettings(file=written(tmp_path, FILE), coupling=0.0, lever=0.0)
    model, pressure = choose_model(settings, DEFAULT_STIFFNESS, Hand(), LATER)
    assert isinstance(model, BushingModel)
    estimate = RelativePoseEstimate(0.0, make_pose(p=(0.0, 0.0, -0.01)), 1e-14 * np.eye(6))
    told = model.spring(estimate)
    assert_allclose(np.sqrt(told.covariance[5, 5]), 8.0 * np.sqrt(0.03**2 + 0.05**2 + 0.06**2), rtol=1e-3)
    assert pressure.reason == ""


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (WrenchSettings(file="nowhere.yaml"), "nowhere.yaml"),
    ],
)
def test_a_missing_file_is_refused(settings: WrenchSettings, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        choose_model(settings, DEFAULT_STIFFNESS, Hand(), LATER)


def test_an_identification_of_another_hand_or_without_date_is_refused(tmp_path: Path) -> None:
    other = written(tmp_path, replace(FILE, hand="other_hand"))
    with pytest.raises(ConfigError, match=r"identified with the hand 'other_hand'; hand.name is 'soft_bubble'"):
        choose_model(WrenchSettings(file=other), DEFAULT_STIFFNESS, Hand(), LATER)
    dated = written(tmp_path, replace(FILE, date="last summer"))
    with pytest.raises(ConfigError, match="date = 'last summer'"):
        choose_model(WrenchSettings(file=dated), DEFAULT_STIFFNESS, Hand(), LATER)
    assert_allclose(age("2026-03-07T12:00:00", LATER), 0.5)


class OfMembranes:
    """As a map of membranes does where nobody tells their motion."""

    name, stiffness = "membrane", DEFAULT_STIFFNESS

    def spring(self, estimate: RelativePoseEstimate) -> SpringWrench:
        told = ", ".join(m.finger for m in estimate.membrane) or "none"
        why = f"motion of both membranes is needed; told: {told}"
        return SpringWrench(Wrench.zero(), np.full((6, 6), np.inf), why)


def test_an_estimator_without_membranes_is_named_and_nothing_moves() -> None:
    bench = Bench(model=OfMembranes())
    bench.run(0.5)
    assert bench.controller.law.measured is None
    assert bench.state.counters.estimates_invalid > 10
    assert "wrench model 'membrane' cannot tell the wrench" in bench.state.reason
    assert "motion of both membranes is needed; told: none" in bench.state.reason
    with pytest.raises(Exception, match="cannot enable: no estimate"):
        bench.controller.enable(bench.t)
