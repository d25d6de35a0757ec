# SPDX-License-Identifier: Apache-2.0
"""The slip margin and the grip that keeps it, against Coulomb's law in one place."""

from dataclasses import replace
from itertools import pairwise
from math import isnan

import numpy as np
import pytest

from seed_control.grip import GripControl, GripSettings, KeptLoad, Margin, SlipMargin, SlipSigns, signs_of
from seed_core.bushing import Bushing, Stiffness
from seed_core.config import ConfigError
from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.spatial import Wrench, make_pose

SETTINGS = GripSettings(friction=0.8, friction_deviation=0.1, patch_radius=0.01, margin=0.25)
NO_NOISE = np.zeros((6, 6))
FRAME = 1.0 / 45.0


def pulled(force: tuple[float, float, float], torque: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Wrench:
    return Wrench(np.array(torque), np.array(force))


def margin_of(load: float, stamp: float = 0.0, deviation: float = 0.0) -> Margin:
    """As of a patch with friction 0.8 that is known."""
    return Margin(stamp, 0.5, 0.05, load, deviation, 0.8, 0.5 / 0.8, 0.0)


def test_the_margin_is_what_coulomb_leaves() -> None:
    # two patches of 5 N and friction 0.8 bear 8 N; a torque of 40 mN m at 10 mm counts as 4 N
    m = SlipMargin(SETTINGS).update(0.0, pulled((0.0, 0.0, 4.0)), NO_NOISE, 5.0, SlipSigns())
    assert m.value == pytest.approx(0.5)
    m = SlipMargin(SETTINGS).update(0.0, pulled((0.0, 9.0, 3.0), (1.0, 0.04, 1.0)), NO_NOISE, 5.0, SlipSigns())
    assert m.load == pytest.approx(5.0)
    assert m.value == pytest.approx(1.0 - 5.0 / 8.0)
    assert m.load * m.need == pytest.approx(5.0 / 1.6)  # N of each finger, just enough


def test_the_deviation_is_that_of_many_draws() -> None:
    rng = np.random.default_rng(1)
    C = np.diag([1.0, 0.004, 1.0, 0.3, 1.0, 0.2]) ** 2
    m = SlipMargin(SETTINGS).update(0.0, pulled((1.0, 0.0, 4.0), (0.0, 0.02, 0.0)), C, 6.0, SlipSigns())
    drawn = []
    for _ in range(4000):
        w = np.array((0.0, 0.02, 0.0, 1.0, 0.0, 4.0)) + np.sqrt(np.diag(C)) * rng.normal(size=6)
        x = (1.0 + 0.1 * rng.normal()) / 0.8
        drawn.append(1.0 - np.sqrt(w[3] ** 2 + w[5] ** 2 + (w[1] / 0.01) ** 2) / 12.0 * x)
    assert m.deviation == pytest.approx(np.std(drawn), rel=0.1)
    assert m.value == pytest.approx(np.mean(drawn), abs=0.01)


def test_a_patch_that_slides_early_teaches_a_lower_friction() -> None:
    margin = SlipMargin(SETTINGS)
    margin.update(0.0, pulled((0.0, 0.0, 4.0)), NO_NOISE, 5.0, SlipSigns(0.0, 0.01))
    m = margin.update(FRAME, pulled((0.0, 0.0, 4.0)), NO_NOISE, 5.0, SlipSigns(0.2, 0.5, gross=True))
    assert m.friction < 0.65  # 4 N on 2 x 5 N slide at 0.4
    for i in range(2, 40):
        m = margin.update(i * FRAME, pulled((0.0, 0.0, 4.0)), NO_NOISE, 5.0, SlipSigns(0.2, 0.5, gross=True))
    assert m.friction > 0.4  # creep that does not go on is told once


def test_a_patch_that_sticks_beyond_its_friction_teaches_a_higher_one() -> None:
    margin = SlipMargin(SETTINGS)
    for i in range(30):
        m = margin.update(i * FRAME, pulled((0.0, 0.0, 12.0)), NO_NOISE, 5.0, SlipSigns(0.0, 0.01))
    assert m.friction > 1.2  # it bears 12 N on 2 x 5 N
    assert m.value > 0.1


def test_an_estimator_that_tells_nothing_of_slip_teaches_no_friction() -> None:
    margin = SlipMargin(SETTINGS)
    for i in range(30):
        m = margin.update(
            i * FRAME, pulled((0.0, 0.0, 12.0)), NO_NOISE, 5.0, signs_of(RelativePoseEstimate(0.0, np.eye(4)))
        )
    assert m.friction == pytest.approx(0.8)
    assert m.value == 0.0


def test_slip_is_what_the_membranes_do_not_follow() -> None:
    X_CT, half = make_pose(None, [0.0, 0.001, 0.004]), make_pose(None, [0.0, 0.0, 0.003])
    motions = tuple(MembraneMotion(finger, half) for finger in ("left", "right"))
    assert signs_of(RelativePoseEstimate(0.0, X_CT, membrane=motions)).slip == pytest.approx(0.25)
    assert signs_of(RelativePoseEstimate(0.0, X_CT, slip=0.4, membrane=motions)).slip == 0.4
    small = make_pose(None, [0.0, 0.0, 1e-4])
    assert signs_of(RelativePoseEstimate(0.0, small, membrane=motions)).slip == 0.0
    assert signs_of(RelativePoseEstimate(0.0, X_CT, gross_slip=True)).gross


def test_creep_that_a_falling_load_leaves_behind_teaches_nothing() -> None:
    margin = SlipMargin(SETTINGS)
    for i, load in enumerate(np.linspace(4.0, 0.6, 20)):
        m = margin.update(i * FRAME, pulled((0.0, 0.0, load)), NO_NOISE, 5.0, SlipSigns(0.0, 0.05 * max(i - 3, 0)))
    assert m.friction == pytest.approx(0.8, rel=1e-6)


def test_the_load_stays_while_the_grip_tightens() -> None:
    soft, firm = Stiffness((1.0, 2.0, 1.0), (800.0,) * 3), Stiffness((3.0, 6.0, 3.0), (2400.0,) * 3)
    kept, X = KeptLoad(), make_pose(None, [0.0, 0.0, 0.005])
    assert kept.update(Bushing(soft).wrench(X), soft, X).force[2] == pytest.approx(4.0)
    assert kept.update(Bushing(firm).wrench(X), firm, X).force[2] == pytest.approx(4.0)  # not 12
    X = make_pose(None, [0.0, 0.0, 0.006])
    assert kept.update(Bushing(firm).wrench(X), firm, X).force[2] == pytest.approx(4.0 + 2.4)


def test_it_tightens_at_once_ahead_of_a_load_that_rises() -> None:
    control = GripControl(SETTINGS)
    control.heard(0.0, 0.02, 3.0)
    asked = []
    for i in range(12):
        t = i * FRAME
        control.heard(t, 0.02, 3.0)
        control.image(margin_of(max(0.0, 40.0 * (t - 0.1)), t - 0.03), t)
        asked.append((t, control.command(t).force))
    needed = [max(0.0, 40.0 * (t - 0.1)) * 0.5 / 0.8 / 0.75 for t, _ in asked]
    late = [(t, grip) for (t, grip), need in zip(asked, needed, strict=True) if grip < min(need, 15.0) and need > 3.5]
    assert not late
    assert asked[-1][1] > 3.5


def test_it_relaxes_slowly_to_what_is_necessary() -> None:
    control = GripControl(replace(SETTINGS, least_force=2.0, relax_after=0.5, relax_rate=0.5))
    control.heard(0.0, 0.02, 3.0)
    grips = []
    for i in range(400):
        t = i * FRAME
        control.heard(t, 0.02, control.wanted)
        control.image(margin_of(9.0 if t < 1.0 else 3.6, t), t)
        grips.append(control.command(t).force)
    at = lambda t: grips[round(t / FRAME)]  # noqa: E731
    assert at(0.9) == pytest.approx(9.0 * 0.625 / 0.75, rel=0.02)
    assert at(1.3) > 0.98 * at(0.9)
    assert 0.6 < at(2.0) / at(0.9) < 0.95
    assert grips[-1] == pytest.approx(3.6 * 0.625 / 0.75, rel=0.05)
    assert min(grips) >= 2.0
    falls = -np.diff(grips[round(1.2 / FRAME) :]) / FRAME
    assert falls.max() < 0.55 * at(0.9)


def test_a_width_is_asked_for_where_the_gripper_takes_widths() -> None:
    control = GripControl(replace(SETTINGS, force_per_width=1000.0, min_width=0.012))
    assert isnan(control.command(0.0).width)
    control.heard(0.0, 0.02, 4.0)
    control.image(margin_of(7.2, 0.0), 0.0)
    assert control.command(0.0).width == pytest.approx(0.02 - (control.wanted - 4.0) / 1000.0)
    control.image(margin_of(60.0, 0.1), 0.1)
    assert control.command(0.1).width == pytest.approx(0.012)


def test_fingers_are_not_asked_to_open_further_than_they_do() -> None:
    control = GripControl(replace(SETTINGS, force_per_width=100.0, max_width=0.03, relax_after=0.0))
    control.heard(0.0, 0.02, 12.0)
    for i in range(100):
        t = i * FRAME
        control.heard(t, 0.02, 12.0)
        control.image(margin_of(1.0, t), t)
    assert control.wanted < 10.0  # 2 N less are 2 cm
    assert control.command(t).width == 0.03


def test_no_grip_is_wanted_before_the_gripper_was_heard() -> None:
    control = GripControl(SETTINGS)
    for i in range(3):
        control.image(margin_of(9.0, i * FRAME), i * FRAME)
    told = control.command(2 * FRAME)
    assert isnan(told.force)
    assert isnan(told.width)
    assert "was not heard yet" in told.hold


def test_a_gripper_that_does_not_answer_is_named() -> None:
    control = GripControl(SETTINGS)
    assert "was not heard yet" in control.command(0.0).hold
    control.heard(0.0, 0.02, 3.0)
    assert control.command(0.3).hold == ""
    assert "does not answer" in control.command(1.0).hold
    for i in range(40):  # it tells, and does nothing
        t = 1.0 + i * FRAME
        control.heard(t, 0.02, 3.0)
        control.image(margin_of(9.0, t), t)
        told = control.command(t)
        assert told.force >= 3.0
    assert "does not follow: it grips with 3.0 N where 7.5 N" in told.hold


def test_a_grip_that_was_set_while_nothing_is_sent_is_where_it_goes_on_from() -> None:
    control = GripControl(SETTINGS)
    for i in range(90):  # two seconds of a hand at the gripper, which the load does not ask for
        t = i * FRAME
        control.heard(t, 0.02, 10.0)
        control.image(margin_of(1.0, t), t)
        control.rest(t)
        told = control.command(t)
    assert told.hold == ""
    assert told.force == 10.0
    control.image(margin_of(1.0, t + FRAME), t + FRAME)
    assert control.wanted > 9.9  # it relaxes slowly from there


def test_nothing_relaxes_while_the_gripper_is_silent() -> None:
    control = GripControl(SETTINGS)
    control.heard(0.0, 0.02, 8.0)
    for i in range(1, 180):
        control.image(margin_of(1.0, i * FRAME), i * FRAME)
        if i * FRAME <= SETTINGS.answer_time:
            before = control.wanted
    assert control.wanted >= before
    assert "does not answer" in control.command(4.0).hold


@pytest.mark.parametrize("deviation", [np.nan, np.inf])
def test_a_load_that_is_not_known_keeps_the_grip_until_it_is(deviation: float) -> None:
    """An estimate may state a variance that is not finite; the grip that follows was no number from then on."""
    control = GripControl(SETTINGS)
    control.heard(0.0, 0.02, 5.0)
    control.image(margin_of(5.0, 0.01), 0.01)
    before = control.wanted
    control.image(margin_of(5.0, 0.03, deviation), 0.03)
    assert control.wanted == before
    assert "the load on the grasp is not known" in control.command(0.03).hold
    control.image(margin_of(5.0, 0.05), 0.05)
    assert control.wanted == pytest.approx(before, rel=0.05)
    assert control.command(0.05).hold == ""


def test_fingers_that_close_no_further_without_a_grip_are_named() -> None:
    control = GripControl(replace(SETTINGS, min_width=0.012))
    for i in range(40):
        t = i * FRAME
        control.heard(t, 0.012, 3.0)
        control.image(margin_of(9.0, t), t)
        told = control.command(t)
    assert "12.0 mm apart and close no further (min_width is 12 mm): they grip with 3.0 N" in told.hold


def test_a_load_that_the_grasp_cannot_bear_is_named_and_the_grip_stays_firm() -> None:
    control = GripControl(replace(SETTINGS, max_force=8.0))
    for i in range(30):
        t = i * FRAME
        control.heard(t, 0.02, min(3.0 + i, 8.0))
        control.image(margin_of(20.0, t), t)
    told = control.command(t)
    assert told.force == 8.0
    assert "cannot bear what pulls at the tool: 20.0 N" in told.hold
    assert "max_force is 8 N" in told.hold


def test_a_tool_that_slides_is_gripped_more_firmly_and_never_released() -> None:
    control = GripControl(SETTINGS)
    control.heard(0.0, 0.02, 5.0)
    control.slipped(0.1, 0.1)
    assert control.command(0.1).force > 6.0
    for i in range(300):
        t = 0.2 + i * FRAME
        control.heard(t, 0.02, control.wanted)
        control.image(margin_of(0.1, t), t)
    assert control.command(t).force > 6.0
    control.sticks()
    for _ in range(300):
        t += FRAME
        control.heard(t, 0.02, control.wanted)
        control.image(margin_of(0.1, t), t)
    assert control.command(t).force == pytest.approx(SETTINGS.least_force, rel=0.05)


def test_what_let_the_tool_slide_is_the_grip_at_that_image_not_the_one_that_came_since() -> None:
    control = GripControl(SETTINGS)
    for t, force in ((0.00, 5.0), (0.02, 6.0), (0.05, 10.0)):
        control.heard(t, 0.02, force)
    control.slipped(0.06, 0.025)
    assert control.command(0.06).force == pytest.approx(1.3 * 6.0)


def test_a_load_that_is_told_with_noise_does_not_wind_the_grip_up() -> None:
    """5 % of white noise on 9 N: what is kept stays within 5 % of what they need."""
    control, rng = GripControl(SETTINGS), np.random.default_rng(0)
    control.heard(0.0, 0.02, 3.0)
    for i in range(90):
        t = i * FRAME
        control.heard(t, 0.02, control.wanted)
        control.image(margin_of(9.0 + (0.45 * rng.normal() if t > 0.5 else 0.0), t), t)
    assert control._kept < 1.05 * 9.0 * 0.625 / 0.75


def test_settings_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(ConfigError, match="least_force = 20 N must be at most max_force"):
        GripSettings(least_force=20.0)
    with pytest.raises(ConfigError, match="min_width"):
        GripSettings(min_width=0.2)


def test_a_clock_that_is_set_back_keeps_grip_and_answers_due() -> None:
    control = GripControl(replace(SETTINGS, relax_after=0.5, relax_rate=0.5))
    for start, load in ((100.0, 3.6), (0.0, 9.0), (2.0, 3.6)):
        for i in range(90):
            t = start + i * FRAME
            control.heard(t, 0.02, control.wanted if i or start < 100.0 else 3.0)
            control.image(margin_of(load, t), t)
        if start == 0.0:
            assert control.command(t).force == pytest.approx(9.0 * 0.625 / 0.75, rel=0.02)
    assert control.command(t).force < 0.9 * 9.0 * 0.625 / 0.75
    assert "does not answer" in control.command(t + 1.0).hold
    control.image(margin_of(3.6, -50.0), -50.0)
    assert "does not answer" in control.command(-49.0).hold


def test_a_clock_that_goes_back_a_little_tightens_nothing_beyond_max_force() -> None:
    control = GripControl(SETTINGS)
    t, told = 0.0, []
    for i in range(200):
        t += FRAME - 0.3 * (i in (26, 60, 90))  # as it relaxes from max_force
        control.heard(t, 0.02, control.wanted if i else SETTINGS.max_force)
        control.image(margin_of(1.0, t), t)
        told += [control.command(t).force]
    assert max(told) <= SETTINGS.max_force
    assert all(b <= a for a, b in pairwise(told))
