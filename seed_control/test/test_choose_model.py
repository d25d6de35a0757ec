# SPDX-License-Identifier: Apache-2.0
"""Which model the wrench comes from: chosen by name, from a file of this hand, or refused in words."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import Bench

from seed_control.wrench.choose_model import age, choose_model
from seed_control.wrench.stiffness_schedule import ScheduleFollower
from seed_core.bushing import Bushing
from seed_core.config import ConfigError
from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Hand
from seed_core.hysteretic.file import hysteretic_file, save_hysteretic
from seed_core.hysteretic.spring import HystereticStiffness
from seed_core.membrane.features import NAMES, SCALES
from seed_core.membrane.map_file import GripMap, MembraneMapFile, format_rows, save_membrane_map
from seed_core.spatial import Wrench, inverse_pose, make_pose, rotation_from_rpy
from seed_core.stiffness_file import GripStiffness, IdentifiedGrip, StiffnessFile, save_stiffness
from seed_core.wrench_model import BushingModel, SpringWrench
from seed_core.wrench_settings import WrenchSettings

GRIP = IdentifiedGrip(
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


def test_what_an_identification_left_unexplained_counts_where_it_is_more_than_usual(tmp_path: Path) -> None:
    """8 N along z and along x, of which 30 % and 2 % were not explained: the latter is 5 % all the same."""
    file = replace(FILE, date="2026-03-08", force_unexplained=(0.02, 0.1, 0.3))
    settings = WrenchSettings(file=written(tmp_path, file), coupling=0.0, lever=0.0)
    model, _ = choose_model(settings, DEFAULT_STIFFNESS, Hand(), LATER)
    for axis, own in ((0, np.hypot(0.01, 0.05)), (2, np.hypot(0.03, 0.3))):
        estimate = RelativePoseEstimate(0.0, make_pose(p=-0.01 * np.eye(3)[axis]), 1e-14 * np.eye(6))
        assert_allclose(np.sqrt(model.spring(estimate).covariance[3 + axis, 3 + axis]), 8.0 * own, rtol=1e-3)


def test_the_file_that_the_stiffness_follows_tells_how_well_it_is_known_and_checks_no_pressure(tmp_path: Path) -> None:
    settings, name = WrenchSettings(coupling=0.0, lever=0.0), written(tmp_path, FILE)
    model, pressure = choose_model(settings, DEFAULT_STIFFNESS, Hand(), LATER, name)
    same, _ = choose_model(replace(settings, file=name), DEFAULT_STIFFNESS, Hand(), LATER)
    estimate = RelativePoseEstimate(0.0, make_pose(p=(0.0, 0.0, -0.01)), 1e-14 * np.eye(6))
    assert_allclose(model.spring(estimate).covariance, same.spring(estimate).covariance)
    membrane = tuple(MembraneMotion(f, np.eye(4), pressure=9.0, indentation=2e-3) for f in ("left", "right"))
    pressure.update(replace(estimate, membrane=membrane))
    assert pressure.reason == ""


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (WrenchSettings(model="membrane"), "wrench.model = 'membrane' needs wrench.file"),
        (WrenchSettings(model="membrane", file="nowhere.yaml"), "nowhere.yaml"),
        (WrenchSettings(file="nowhere.yaml"), "nowhere.yaml"),
    ],
)
def test_a_missing_file_is_refused(settings: WrenchSettings, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        choose_model(settings, DEFAULT_STIFFNESS, Hand(), LATER)


def test_a_model_that_cannot_be_made_is_refused_not_replaced() -> None:
    with pytest.raises(ConfigError, match=r"wrench.model = 'mine': .*choose_model cannot make it"):
        choose_model(WrenchSettings(model="mine"), DEFAULT_STIFFNESS, Hand(), LATER)


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


def membrane_file(folder: Path, hand: str) -> str:
    """A map of 800 N/m along x and z, 1200 along y, where the patches stick to the tool."""
    terms, stiffness = ("roll-", "pitch+", "yaw-", "x+", "y-", "z+"), (4.0, 3.0, 4.0, 800.0, 1200.0, 800.0)
    scales = [SCALES[NAMES.index(name)] for name in terms]
    grip = GripMap(
        pressure_hpa=1030.0,
        width_m=0.02,
        left_middle=(0.0, 0.012, 0.0),
        right_middle=(0.0, -0.012, 0.0),
        torque_std=(0.002,) * 3,
        force_std=(0.1,) * 3,
        coefficients=format_rows(-np.diag(np.array(stiffness) * scales)),
        spread=format_rows(0.1 * np.eye(6)),
    )
    largest = (20.0,) * len(NAMES)
    file = MembraneMapFile(hand, "t", "2026-01-31", tuple(SCALES.tolist()), terms, largest, 100.0, (grip,))
    save_membrane_map(folder / "membrane_map.yaml", file)
    return str(folder / "membrane_map.yaml")


def test_the_force_comes_from_the_membranes_where_their_map_is_chosen(tmp_path: Path) -> None:
    """A tool that slides on its membranes by a third of its motion: a map of its pose would tell half as much again."""
    settings = WrenchSettings(model="membrane", file=membrane_file(tmp_path, Hand().name))
    model, pressure = choose_model(settings, DEFAULT_STIFFNESS, Hand())
    assert model.name == "membrane"
    bench = Bench(model=model, pressure=pressure)

    def told(estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        """Poses of the tool 1.5 times as far as the material that carries it."""
        X = estimate.X_CT
        membrane = tuple(
            MembraneMotion(f, X, deformation=np.zeros(9), pressure=1030.0, indentation=2e-3) for f in ("left", "right")
        )
        return replace(estimate, X_CT=make_pose(X[:3, :3], 1.5 * X[:3, 3]), membrane=membrane)

    bench.told = told
    bench.enabled()
    bench.press(6.0)
    bench.run(4.0)
    assert_allclose(bench.forces[-100:], 6.0, atol=0.15)
    bench.told = lambda e: replace(told(e), membrane=tuple(replace(m, pressure=103.0) for m in told(e).membrane))
    bench.run(0.3)
    assert bench.state.mode == "holding"
    assert "pressure of the left bubble is 103 hPa; the grasp was identified at 1030 hPa" in bench.state.reason
    assert "it looks like kPa" in bench.state.reason


def test_a_map_of_another_hand_is_refused(tmp_path: Path) -> None:
    settings = WrenchSettings(model="membrane", file=membrane_file(tmp_path, "other_hand"))
    with pytest.raises(ConfigError, match="identified with the hand 'other_hand'"):
        choose_model(settings, DEFAULT_STIFFNESS, Hand())


def test_an_estimator_without_membranes_is_named_and_nothing_moves() -> None:
    bench = Bench(model=OfMembranes())
    bench.run(0.5)
    assert bench.controller.law.measured is None
    assert bench.state.counters.estimates_invalid > 10
    assert "wrench model 'membrane' cannot tell the wrench" in bench.state.reason
    assert "motion of both membranes is needed; told: none" in bench.state.reason
    with pytest.raises(Exception, match="cannot enable: no estimate"):
        bench.controller.enable(bench.t)


def test_the_force_comes_from_a_hysteretic_spring_where_its_file_is_chosen(tmp_path: Path) -> None:
    """Without rise and friction it is the midpoint bushing; of another hand, or without a file, it is refused."""
    k = np.array((*DEFAULT_STIFFNESS.rotation, *DEFAULT_STIFFNESS.translation))
    straight = HystereticStiffness(
        stiffness=k,
        rise=np.zeros(6),
        yields=np.full((1, 6), 0.01),
        friction=np.zeros((1, 6)),
        covariance=np.zeros((6, 3, 3)),
        residual=np.zeros(6),
        largest=np.full(6, 0.2),
        centre=np.zeros(3),
    )
    file = tmp_path / "hysteretic_spring.yaml"
    save_hysteretic(file, hysteretic_file(straight, Hand().name, "squeegee", "2026-01-31", 1030.0, 0.02))
    settings = WrenchSettings(model="hysteretic", file=str(file))
    chosen = choose_model(settings, DEFAULT_STIFFNESS, Hand()).model
    X_TC = make_pose(rotation_from_rpy(np.array((0.1, -0.05, 0.02))), (0.002, 0.001, 0.006))
    told = chosen.spring(RelativePoseEstimate(0.0, inverse_pose(X_TC))).wrench.vector()
    assert chosen.name == "hysteretic"
    assert_allclose(told, Bushing(DEFAULT_STIFFNESS).wrench(X_TC).vector(), atol=1e-9)
    with pytest.raises(ConfigError, match="identified with the hand"):
        choose_model(settings, DEFAULT_STIFFNESS, replace(Hand(), name="other"))
    with pytest.raises(ConfigError, match=r"needs wrench\.file"):
        choose_model(WrenchSettings(model="hysteretic"), DEFAULT_STIFFNESS, Hand())


def test_a_stiffness_that_is_to_follow_pressures_that_nobody_measured_is_refused() -> None:
    grips = replace(GRIP, pressure_hpa=0.0), replace(GRIP, pressure_hpa=0.0, width_m=0.014)
    stiffness = GripStiffness(replace(FILE, grips=grips))
    with pytest.raises(ConfigError, match=r"have no pressures: set grip\.follow to width"):
        ScheduleFollower(stiffness, "pressure")
    assert ScheduleFollower(stiffness, "width").update(0.014) == grips[1].stiffness
    alone = GripStiffness(replace(FILE, grips=grips[:1]))
    assert ScheduleFollower(alone, "pressure").update(1030.0) == GRIP.stiffness


def test_a_change_of_stiffness_is_passed_on_once_it_is_half_a_per_cent_of_what_was_passed_on_last() -> None:
    """Two grips 20 hPa apart, of twice the stiffness about one axis alone: 5 % each hPa there, of the first."""
    x, y, z = GRIP.rotation
    grips = replace(GRIP, pressure_hpa=20.0, width_m=0.03), replace(GRIP, pressure_hpa=40.0, rotation=(x, 2.0 * y, z))
    follower = ScheduleFollower(GripStiffness(replace(FILE, grips=grips)), "pressure")
    assert follower.pressures == [20.0, 40.0]
    told = [follower.update(p) for p in (20.0, 20.09, 20.11, 20.15, 20.06, 20.0)]
    assert [now is not None for now in told] == [True, False, True, False, False, True]
    assert told[2] is not None
    np.testing.assert_allclose(told[2].rotation, (x, y * (1.0 + 0.11 / 20.0), z))
