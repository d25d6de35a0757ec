# SPDX-License-Identifier: Apache-2.0
"""The simulated gripper, and pulls at grasps between membranes with the grip that answers slip and without."""

from dataclasses import replace

import numpy as np
import pytest

from seed_core.bushing import Bushing, Stiffness
from seed_core.spatial import inverse_pose
from seed_sim.gripper.gripper import GripperSection, SimulatedGripper
from seed_sim.gripper.held import DT, HeldTool, TornError
from seed_sim.gripper.pulls import KINDS, RADIUS, draw
from seed_sim.gripper.score import PullScore, summary, table
from seed_sim.gripper.trial import PullOutcome, _material, holds, run_pull

SECTION = GripperSection(speed=0.1, latency=0.02, max_force=10.0)
SPRING = 800.0  # [N/m] of the push per closed metre


def push(width: float) -> float:
    return max(0.0, SPRING * (0.02 - width))


def moved(gripper: SimulatedGripper, until: float, dt: float = 1e-3) -> list[float]:
    return [gripper.advance(i * dt, dt, push(gripper.width), SPRING) for i in range(1, round(until / dt) + 1)]


def test_it_answers_late_and_no_faster_than_its_speed() -> None:
    gripper = SimulatedGripper(SECTION, 0.02)
    gripper.command_width(0.0, 0.015)
    widths = moved(gripper, 0.1)
    assert widths[18] == 0.02
    assert np.abs(np.diff(widths)).max() <= 0.1 * 1e-3 + 1e-12
    assert widths[68] > 0.015  # 20 ms late, then 5 mm at 0.1 m/s
    assert widths[72] == pytest.approx(0.015)


def test_a_force_is_reached_and_no_more_than_the_most() -> None:
    gripper = SimulatedGripper(SECTION, 0.02)
    gripper.command_force(0.0, 4.0)
    moved(gripper, 0.3)
    assert push(gripper.width) == pytest.approx(4.0, abs=0.02)
    for command in (gripper.command_force, gripper.command_width):
        command(0.0, 50.0 if command == gripper.command_force else 0.0)
        moved(gripper, 0.5)
        assert push(gripper.width) == pytest.approx(10.0, abs=0.1)


def test_one_that_does_not_answer_stays_and_nonsense_is_no_command() -> None:
    deaf = SimulatedGripper(replace(SECTION, answers=False), 0.02)
    deaf.command_width(0.0, 0.01)
    gripper = SimulatedGripper(SECTION, 0.02)
    gripper.command_width(0.0, float("nan"))
    assert moved(deaf, 0.1)[-1] == moved(gripper, 0.1)[-1] == 0.02


def test_sliding_begins_where_coulomb_says() -> None:
    """A slow pull along the tool's axis: friction of both patches bears 2 mu N, and then the tool is torn out."""
    pull = replace(draw("pull", 3), direction=(0.0, 0.0, 1.0), lever=0.0, strength=1.3, rise=1.0)
    held = HeldTool(pull, start=pull.begins)
    borne = 0.0
    why = ""
    while not why and held.t < pull.ends:
        try:
            held.advance()
        except TornError as error:
            why = str(error)
        borne = max(borne, abs(held.spring.force[2]))
    assert why == "the tool slid by more than 5 mm"
    assert borne == pytest.approx(2.0 * pull.membrane.friction * held.grip, rel=0.1)


def test_the_answer_holds_what_a_grip_that_stays_loses() -> None:
    pull = draw("pull", 4)
    assert not holds(pull, pull.membrane.squeeze)
    answer = run_pull(pull)
    assert not answer.broken
    assert answer.slid < 0.002
    assert answer.more - answer.onset <= 0.05
    assert answer.reason == ""


def test_a_load_is_told_by_how_the_material_has_moved() -> None:
    """A patch turns further on its membrane than it shifts: one share of slip for both told 1.6 times this load."""
    pull = replace(draw("pull", 601), strength=0.9, stay=0.2)
    held = HeldTool(pull, start=pull.begins)
    (stiffness, _), *_ = held.stiffness_at([held.first])
    while held.t < pull.begins + pull.rise + 0.1:
        held.advance()
    X_CT = _material(held.X_CT, held.lag(), 0.0)
    told = Bushing(Stiffness.from_vector(stiffness)).wrench(inverse_pose(X_CT)).rotated(X_CT[:3, :3])
    size = [float(np.linalg.norm((w.force[0], w.force[2], w.torque[1] / RADIUS))) for w in (told, held.spring)]
    assert size[0] == pytest.approx(size[1], rel=0.2)


def test_a_gripper_too_weak_for_the_pull_is_named() -> None:
    pull = replace(draw("pull", 4), strength=1.2, rise=0.3)
    answer = run_pull(pull, gripper=GripperSection(answers=False))
    assert "the gripper does not follow" in answer.reason or answer.broken


def test_every_kind_of_pull_ends_where_it_began() -> None:
    for kind in KINDS:
        pull = draw(kind, 5)
        shares = [pull.share(t) for t in np.arange(0.0, pull.ends + 0.1, DT)]
        assert shares[0] == pull.share(pull.ends + 0.01) == 0.0
        assert max(shares) == pytest.approx(1.0, abs=0.05)


def test_the_score_counts_what_breaks() -> None:
    held = PullOutcome(False, 0.001, 0.40, 0.43, 6.0, 7.0, "", ())
    broken = PullOutcome(True, 0.005, 0.40, 0.46, 3.0, 4.0, "", ())
    result = summary([PullScore("pull", 1, True, held, 4.0), PullScore("pull", 2, True, broken, 4.0)])["pull"]
    assert (result["broken_without"], result["broken_with"]) == (1.0, 0.5)
    assert result["onset_to_grip_ms_most"] == pytest.approx(60.0)
    assert result["grip_over_necessary_mean"] == pytest.approx(4.5 / 4.0)
    assert "pull" in table({"pull": result})
