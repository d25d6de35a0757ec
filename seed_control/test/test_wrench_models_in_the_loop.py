# SPDX-License-Identifier: Apache-2.0
"""The law on another wrench model than the bushing: force follows the model, though its local stiffness is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from quasi_static import DT, Bench

from seed_control.wrench.estimate import MOST_DISCREPANCY, bounded
from seed_core.bushing import Bushing, Stiffness
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS
from seed_core.hysteretic.spring import HystereticSpring, HystereticStiffness
from seed_core.spatial import Wrench, inverse_pose, make_pose
from seed_core.wrench_model import BushingModel, SpringWrench
from seed_core.wrench_settings import ReferenceSettings


class TrueMap:
    """Tells the plant's own wrench, and another local stiffness."""

    name = "true"

    def __init__(self, true: Stiffness, share: float) -> None:
        self._map, self.stiffness = Bushing(true), true.scaled(share)

    def spring(self, estimate: RelativePoseEstimate) -> SpringWrench:
        return SpringWrench(self._map.wrench(inverse_pose(estimate.X_CT)), 1e-4 * np.eye(6))


@pytest.mark.parametrize("k_table", [2e3, 4e4])
@pytest.mark.parametrize("delay", [0.02, 0.12])
@pytest.mark.parametrize("share", [0.7, 1.3])
def test_the_force_is_the_models_and_settles(share: float, delay: float, k_table: float) -> None:
    bench = Bench(model=TrueMap(DEFAULT_STIFFNESS, share), delay=delay, k_table=k_table).enabled()
    bench.press(8.0)
    bench.run(6.0)
    last = np.array(bench.forces[-round(1.5 / DT) :])
    assert_allclose(last, 8.0, atol=0.08)  # by the bushing alone it is 8 N / share
    assert max(bench.forces) < 1.6 * 8.0


def test_a_map_of_the_tools_pose_in_a_model_commands_the_very_same_motion() -> None:
    commands = []
    for model in (None, BushingModel(Bushing(DEFAULT_STIFFNESS))):
        bench = Bench(model=model).enabled()
        bench.press(5.0)
        bench.run(1.5)
        commands.append(np.array(bench.commands))
    assert np.array_equal(*commands)


def test_a_model_far_from_its_own_stiffness_is_followed_no_further_than_the_loop_endures() -> None:
    spring, told = Wrench(np.array((0.5, 0.0, 0.0)), np.array((0.0, 0.0, 20.0))), Wrench.zero()
    left = bounded(spring.minus(told), spring)
    assert_allclose(left.force, (0.0, 0.0, 20.0 * MOST_DISCREPANCY + 1.0))
    assert_allclose(left.torque, (0.5 * MOST_DISCREPANCY + 0.05, 0.0, 0.0))


@pytest.mark.parametrize("correct", [False, True])
def test_a_model_that_tells_too_little_force_does_not_run_away(correct: bool) -> None:
    """Half of the force told: twice the force at rest, and no swing, though local stiffness and model disagree.

    Free, half of the weight is missing. One attitude cannot say whether as a share or as an offset, and a factor of two
    is the less likely: the weight's correction adds the missing half to whatever is told, and the law presses twice
    that more.
    """

    class Half(TrueMap):
        def spring(self, estimate: RelativePoseEstimate) -> SpringWrench:
            whole = super().spring(estimate)
            return whole._replace(wrench=Wrench(0.5 * whole.wrench.torque, 0.5 * whole.wrench.force))

    references = ReferenceSettings(correct=correct)
    high = make_pose(p=(0.0, 0.0, 0.02)) @ Bench().start  # the weight tells something only after some way in the air
    bench = Bench(model=Half(DEFAULT_STIFFNESS, 1.0), delay=0.1, references=references, start=high).enabled()
    bench.press(6.0)
    bench.run(7.0)
    weight = bench.tool.mass * 9.81
    missing = 0.5 * weight if correct else 0.0
    assert_allclose(bench.forces[-400:], 2.0 * (6.0 - weight + missing) + weight, atol=0.3 if correct else 0.1)
    assert np.ptp(bench.forces[-400:]) < 0.1


def test_the_state_tells_standard_deviations_in_the_task_frame() -> None:
    bench = Bench().enabled()
    bench.press(8.0)
    state = bench.run(2.0)
    assert state.deviation is not None
    assert state.estimated is not None
    # 5 % of a stiffness that nobody identified and 5 % of residual, of the force with the weight on the spring
    spring = abs(state.estimated.force[2]) - bench.tool.mass * 9.81
    assert_allclose(state.deviation.force[2], spring * np.hypot(0.05, 0.05), rtol=0.2)
    assert state.covariance is not None
    assert np.linalg.eigvalsh(state.covariance).min() > 0.0


def with_friction(share: float) -> HystereticSpring:
    """A model of the bench's spring in which friction bears a share of what the spring bears when fully deflected."""
    K, full = DEFAULT_STIFFNESS.vector(), np.array((0.2, 0.2, 0.2, 0.02, 0.02, 0.02))
    friction = share * K * full
    return HystereticSpring(
        HystereticStiffness(
            K, np.zeros(6), 0.3 * full[None], friction[None], np.zeros((6, 3, 3)), np.zeros(6), full, np.zeros(3)
        )
    )


def test_a_pose_that_is_refused_leaves_nothing_in_the_memory_of_a_model() -> None:
    model = with_friction(0.01)
    bench = Bench(model=model).enabled()
    bench.press(3.0)
    bench.run(2.0)
    once = iter([True])

    def told(estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        far = make_pose(None, (0.02, 0.02, 0.02)) if next(once, False) else np.eye(4)
        return replace(estimate, X_CT=estimate.X_CT @ far)

    before = model._z.copy()
    bench.told = told
    bench.run(0.1)
    assert next(once, "") == "", "it was told"
    assert bench.state.mode != "holding", bench.state.reason
    assert_allclose(model._z, before, atol=0.05)


def test_images_that_nobody_can_use_take_no_memory_away() -> None:
    """Loaded, and partly unloaded, a spring with friction tells more by its memory than it would tell without."""
    bench = Bench(model=with_friction(0.1)).enabled()
    bench.press(7.0)
    bench.run(3.0)
    bench.press(3.0)
    bench.run(2.0)
    before, bad = bench.state.estimated.force[2], 0  # type: ignore[union-attr]

    def dark(e: RelativePoseEstimate) -> RelativePoseEstimate:
        nonlocal bad
        bad += 1
        return replace(e, valid=False, reason="image is dark") if bad <= 3 else e

    bench.told = dark
    bench.run(0.6)
    assert bench.state.mode == "holding"
    assert_allclose(bench.state.estimated.force[2], before, atol=0.05)  # type: ignore[union-attr]


def test_a_stiffness_that_a_model_of_its_own_does_not_take_changes_nothing_that_was_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench, told = Bench(model=TrueMap(DEFAULT_STIFFNESS, 1.0)).enabled(), list[bool]()
    monkeypatch.setattr(bench.controller.supervisor.references, "new_stiffness", lambda: told.append(True))
    bench.controller.set_stiffness(DEFAULT_STIFFNESS.scaled(2.0), bench.t)
    assert not told
    bushing = Bench().enabled()
    monkeypatch.setattr(bushing.controller.supervisor.references, "new_stiffness", lambda: told.append(True))
    bushing.controller.set_stiffness(DEFAULT_STIFFNESS.scaled(2.0), bushing.t)
    assert told == [True]
