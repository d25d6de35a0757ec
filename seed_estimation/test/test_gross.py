# SPDX-License-Identifier: Apache-2.0
"""A tool that breaks loose raises the alarm at once; whatever else befalls a tool that sticks does not."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from seed_core.hand import Hand
from seed_core.spatial import Array, inverse_pose, make_pose, pose_from_rpy
from seed_estimation import Estimator, EstimatorParameters
from seed_estimation.slip.gross import (
    FALL,
    FALL_SHARE,
    LOADED,
    MOST,
    depth_went_on,
    slipped_at_edge,
    sprung_back,
    tool_went_along,
    without_load,
)
from seed_estimation.slip.markers import JITTER, UNSEEN, Depth, Observation

tactile = pytest.importorskip("seed_sim.tactile", reason="needs the renderer of seed_sim")
friction = pytest.importorskip("seed_sim.tactile.friction", reason="needs the renderer of seed_sim")

PERIOD, SUBSTEPS = 1.0 / 45.0, 10
ONSET_TO_ALARM = 0.1  # [s]
Motion = Callable[[float], Array]


def along_z(t: float) -> Array:
    return make_pose(p=(0.0, 0.0, 0.06 * t))


def along_x(t: float) -> Array:
    return make_pose(p=(-0.05 * t, 0.0, 0.0))


def about_y(t: float) -> Array:
    return pose_from_rpy((0.0, 2.0 * t, 0.0), np.zeros(3))


class Held:
    """A tool in the grasp of bubbles that stick and slip."""

    def __init__(self, hold: float, kinetic: float = 0.75, seed: int = 77, **settings: Any) -> None:
        p = replace(tactile.TactileParameters(), hold=hold, kinetic=kinetic, **settings)
        self.renderer = tactile.TactileRenderer(p, Hand(), seed)
        self.friction = friction.Friction(hold, kinetic, self.renderer.reach)
        self.estimator = Estimator(EstimatorParameters(), Hand(), self.renderer.cameras)
        self.estimator.capture_reference([self.renderer.no_contact(-2.0 + 0.02 * i) for i in range(12)])
        self.estimator.initialize_grasp([self.renderer.render(np.eye(4), -0.2 + 0.02 * i) for i in range(6)])
        self.onset = np.inf

    def follow(self, motion: Motion, duration: float) -> list[tuple[float, Any]]:
        """(time, estimate) of each pair of images."""
        out = []
        for i in range(1, int(duration / PERIOD)):
            for k in range(1, SUBSTEPS + 1):
                t = (i - 1 + k / SUBSTEPS) * PERIOD
                held = self.friction.step(motion(t), t)
                self.onset = min(self.onset, t) if held.sliding else self.onset
            images = self.renderer.render(motion(t), t, held.X_slid, held.load)
            out.append((t, self.estimator.update(images, t)))
            if t > self.onset + 2.0 * ONSET_TO_ALARM:
                break
        return out


def first_alarm(seen: list[tuple[float, Any]]) -> float:
    return next((t for t, estimate in seen if estimate.gross_slip), np.inf)


@pytest.mark.parametrize("motion", [along_z, along_x, about_y])
@pytest.mark.parametrize("kinetic", [0.65, 0.85])
def test_a_tool_that_breaks_loose_raises_the_alarm(motion: Motion, kinetic: float) -> None:
    held = Held(0.007, kinetic)
    seen = held.follow(motion, 1.0)
    assert np.isfinite(held.onset)
    assert held.onset <= first_alarm(seen) <= held.onset + ONSET_TO_ALARM
    after = [estimate for t, estimate in seen if t >= first_alarm(seen)]
    assert all(e.gross_slip and not e.valid and "initialize the grasp again" in e.reason for e in after)


def slowly_along_x(t: float) -> Array:
    return make_pose(p=(0.04 * t, 0.0, 0.0))


NOISY, BOX = {"noise": 2.0}, {"tool": tactile.parameters.ToolShape("box", width=0.02)}


@pytest.mark.parametrize("settings", [NOISY, BOX], ids=["noisy", "box"])
def test_depth_tells_a_slip_in_which_nothing_springs_back(settings: dict[str, Any]) -> None:
    """Depth of one image is known to 0.13 mm with twice the noise, and to 0.18 mm across a box."""
    held = Held(0.005, 1.0, **settings)
    seen = held.follow(slowly_along_x, 1.0)
    assert np.isfinite(held.onset)
    assert held.onset <= first_alarm(seen) <= held.onset + ONSET_TO_ALARM


def test_a_slow_slip_is_told() -> None:
    """4 mm/s are 0.09 mm from image to image."""
    held = Held(0.002, 1.0)
    seen = held.follow(lambda t: make_pose(p=(0.004 * t, 0.0, 0.0)), 1.0)
    assert held.onset <= first_alarm(seen) <= held.onset + 0.3


def test_material_of_a_lost_track_that_stops_late_is_a_slip() -> None:
    """The tool jumps at 0.2 s, and the track is lost; it drags its material on by 0.4 of its way until 0.42 s."""
    held = Held(0.05, 1.0)
    tool = stuck = 0.0
    seen = []
    for t in PERIOD * np.arange(1, 30):
        step = 0.02 * PERIOD + (0.003 if 0.2 <= t < 0.2 + PERIOD else 0.0)
        tool += step
        stuck += step * (1.0 if t < 0.2 else 0.4 if t < 0.42 else 0.0)
        X, X_slid = make_pose(p=(tool, 0.0, 0.0)), make_pose(p=(tool - stuck, 0.0, 0.0))
        seen.append((t, held.estimator.update(held.renderer.render(X, t, X_slid, 0.7), t)))
    lost = next(t for t, estimate in seen if not estimate.valid)
    assert lost < 0.25
    assert 0.42 <= first_alarm(seen) <= 0.42 + ONSET_TO_ALARM


@pytest.mark.parametrize("motion", [along_z, about_y])
def test_one_finger_alone_sees_a_slip(motion: Motion) -> None:
    held = Held(0.007, fingers="right")
    seen = held.follow(motion, 1.0)
    assert held.onset <= first_alarm(seen) <= held.onset + ONSET_TO_ALARM


def test_after_a_slip_a_new_grasp_starts_afresh() -> None:
    held = Held(0.007)
    last, _ = held.follow(along_z, 1.0)[-1]
    X = along_z(last)
    slid = held.friction.step(X, last).X_slid
    stamps = last + PERIOD * np.arange(1, 10)
    held.estimator.initialize_grasp([held.renderer.render(X, t, slid, 0.75) for t in stamps[:6]])
    again = held.estimator.update(held.renderer.render(X, stamps[6], slid, 0.75), stamps[6])
    assert again.valid
    assert not again.gross_slip
    dragged = X @ inverse_pose(slid)  # the membranes still are: from where they are free T := C counts
    assert np.abs(again.X_CT - dragged).max() < 1e-3


def ordinary(t: float) -> Array:
    return pose_from_rpy(
        np.deg2rad((4.0 * np.sin(2.1 * t), 5.0 * np.sin(1.7 * t), 3.0 * np.sin(1.3 * t))),
        1e-3 * np.array((3.0 * np.sin(1.9 * t), 0.8 * np.sin(1.1 * t), 2.5 * np.sin(2.3 * t))),
    )


def stopped(t: float) -> Array:
    return make_pose(p=(0.0, 0.0, 0.06 * min(t, 0.1)))


def set_free(t: float) -> Array:
    return make_pose(p=(0.0, 0.0, 0.06 * t if t < 0.1 else 0.0003))


def let_go_by_a_part(t: float) -> Array:
    return make_pose(p=(0.0, 0.0, 0.08 * t if t < 0.1 else 0.005))


def jerked_back(t: float) -> Array:
    """A way across the tool, which depth sees, and some along it, which depth does not; the former is taken back."""
    share, after = min(t / 0.5, 1.0), max(t - 0.5, 0.0)
    return make_pose(p=(-0.0055 * share + 0.067 * after, 0.0, 0.004 * share))


@pytest.mark.parametrize(
    ("motion", "duration"),
    [(ordinary, 3.0), (stopped, 0.5), (set_free, 0.5), (let_go_by_a_part, 0.5), (jerked_back, 0.56)],
    ids=lambda v: getattr(v, "__name__", ""),
)
def test_a_tool_that_sticks_raises_none(motion: Motion, duration: float) -> None:
    held = Held(0.009)
    seen = held.follow(motion, duration)
    assert held.onset == np.inf
    assert first_alarm(seen) == np.inf
    assert seen[-1][1].valid


def off_one_finger(t: float) -> Array:
    share = min(t / 0.6, 1.0)
    turn = np.deg2rad((-5.0 * share, 10.0 * share, -3.0 * share))
    return pose_from_rpy(turn, np.array((-0.0055 * share, -0.0035 * share - 0.012 * max(t - 0.6, 0.0), -0.005 * share)))


def test_a_membrane_that_the_tool_leaves_may_spring_back() -> None:
    held = Held(0.012, seed=79)
    seen = held.follow(off_one_finger, 1.2)
    assert held.onset == np.inf
    assert first_alarm(seen) == np.inf
    assert seen[-1][1].valid
    assert "touches nothing" in seen[-1][1].reason


def test_micro_slip_is_none() -> None:
    seen = Held(0.009, slip=0.2).follow(ordinary, 2.5)
    assert first_alarm(seen) == np.inf


@pytest.mark.parametrize("unlocked", [(), (4,), (0, 3)])
def test_frames_without_a_lock_do_not_tear_depth_from_markers(unlocked: tuple[int, ...]) -> None:
    """A tool that moves on, markers and depth as one, while some frames are not locked: nothing has gone on alone."""
    seen = []
    for i in range(7):
        way = np.array((0.0, 4e-3 + 2.5e-4 * i, 0.0))
        depth = UNSEEN if i in unlocked else Depth(way, np.full(3, 5e-5))
        seen.append(Observation(i / 45.0, way, float(way[1]), depth, 0.0, False, 0.0))
    assert not depth_went_on(seen)


def observed(ways: list[tuple[float, float, float]], incipient: float = 0.1, depth: Depth = UNSEEN,
             doubtful: bool = False, loss: float = 0.05) -> list[Observation]:  # fmt: skip
    """The markers of one finger in frames of 45 Hz, at these ways [mm]."""
    out = []
    for i, way_mm in enumerate(ways):
        way = 1e-3 * np.array(way_mm)
        out.append(Observation(i * PERIOD, way, float(np.linalg.norm(way)), depth, incipient, doubtful, loss))
    return out


PULLED = [(0.0, 0.0, 3.0), (0.0, 0.0, 3.2), (0.0, 0.0, 3.4), (0.0, 0.0, 3.6)]


def test_markers_that_fall_back_under_a_load_have_sprung_back() -> None:
    """From 3.6 mm to 3.4 mm: a fall of 0.2 mm, the least that counts."""
    assert sprung_back(observed([*PULLED, (0.0, 0.0, 3.4)]), JITTER) == pytest.approx(1.0, abs=1e-6)
    assert sprung_back(observed([*PULLED, (0.0, 0.0, 3.48)]), JITTER) == 0.0
    assert sprung_back(observed([*PULLED, (0.0, 0.0, 2.0)]), JITTER) == MOST
    assert max(FALL, FALL_SHARE * 3.6e-3) == FALL


def test_markers_that_go_on_or_are_hardly_displaced_have_not() -> None:
    assert sprung_back(observed([*PULLED, (0.0, 0.0, 3.8)]), JITTER) == 0.0
    small = [(0.0, 0.0, 1e3 * LOADED * s) for s in (0.7, 0.8, 0.9, 0.99, 0.2)]
    assert sprung_back(observed(small), JITTER) == 0.0
    assert sprung_back(observed(PULLED[:3]), JITTER) == 0.0


def test_a_fall_within_the_noise_is_none() -> None:
    fall = [*PULLED, (0.0, 0.0, 3.4)]
    assert sprung_back(observed(fall), 1e-4) == 0.0


def test_a_patch_that_is_one_body_again_was_set_free() -> None:
    """No incipient slip is left, unless less of its image is explained than usual."""
    fall = [*PULLED, (0.0, 0.0, 3.2)]
    assert sprung_back(observed(fall, incipient=0.0), JITTER) == 0.0
    assert sprung_back(observed(fall, incipient=0.0, doubtful=True), JITTER) == MOST


def test_a_pull_aside_is_no_springing_back() -> None:
    assert sprung_back(observed([*PULLED, (2.5, 0.0, 2.2)]), JITTER) == 0.0


def test_markers_that_the_tool_goes_with_have_not_sprung_back() -> None:
    seen = observed([*PULLED, (0.0, 0.0, 3.2)])
    together = [s._replace(depth=Depth(s.displacement, np.full(3, 5e-5))) for s in seen]
    staying = [s._replace(depth=Depth(np.array((0.0, 0.0, 3.6e-3)), np.full(3, 5e-5))) for s in seen[-2:]]
    assert sprung_back(together, JITTER) == 0.0
    assert sprung_back([*together[:-2], *staying], JITTER) == MOST


def test_depth_tells_a_fall_that_it_is_fine_enough_for() -> None:
    """To 0.2 mm it tells that the tool went back with its markers by 1 mm, not by 0.2 mm."""
    for back_mm, told in ((1.0, 0.0), (0.2, 1.0)):
        seen = observed([*PULLED, (0.0, 0.0, 3.6 - back_mm)])
        together = [s._replace(depth=Depth(s.displacement, np.full(3, 2e-4))) for s in seen]
        assert sprung_back(together, JITTER) == pytest.approx(told, abs=1e-6)


def test_a_tool_that_is_badly_seen_to_go_back_with_its_markers_has_not_slid() -> None:
    """Depth to 0.1 mm tells a way of 1 mm, not one of 0.2 mm; a tool that stays, or goes back by a third, has slid."""

    def seen(back_mm: float, share: float, deviation: float = 1e-4) -> list[Observation]:
        top, now = (s for s in observed([(0.0, 0.0, 4.0), (0.0, 0.0, 4.0 - back_mm)]))
        deviations = np.full(3, deviation)
        gone = top.displacement + share * (now.displacement - top.displacement)
        return [top._replace(depth=Depth(top.displacement, deviations)), now._replace(depth=Depth(gone, deviations))]

    assert tool_went_along(seen(1.0, 1.0))
    assert not tool_went_along(seen(0.2, 1.0))
    assert tool_went_along(seen(0.2, 1.0, deviation=1e-5))
    assert not tool_went_along(seen(1.0, 0.0))
    assert not tool_went_along(seen(3.0, 0.33))
    assert not tool_went_along([s._replace(depth=UNSEEN) for s in seen(1.0, 1.0)])


def test_a_fall_that_the_pose_explains_is_no_slip() -> None:
    """A membrane that creeps on its edge keeps that when it is unloaded: but the tool's pose explains it as before."""
    lifted = [*PULLED, (0.0, 0.0, 2.6)]
    assert sprung_back(observed(lifted), JITTER) == MOST
    assert sprung_back(observed(lifted, loss=0.01), JITTER) == 0.0


def test_a_finger_whose_edge_has_not_slipped_holds_the_tool() -> None:
    # a gripper that backs off at once, as a firm grasp does after its first contact: one patch creeps, one does not
    assert slipped_at_edge(observed(PULLED, incipient=0.03))
    assert slipped_at_edge(observed(PULLED, incipient=0.0, doubtful=True))
    assert not slipped_at_edge(observed(PULLED, incipient=0.007))
    assert slipped_at_edge([])


def test_markers_without_load_are_set_free() -> None:
    assert without_load([s.size for s in observed([*PULLED, (0.0, 0.0, 1.7)])])
    assert not without_load(
        [s.size for s in observed([*PULLED, (0.0, 0.0, 2.3)])]
    )  # sliding friction of 0.64 of what it stuck with


def test_depth_that_goes_on_without_the_markers_is_seen() -> None:
    seen = []
    for i in range(8):
        way = np.array((0.0, 2e-3, 0.0))
        depth = Depth(way + np.array((0.0, 4e-4 * max(i - 4, 0), 0.0)), np.full(3, 2e-5))
        seen.append(Observation(i * PERIOD, way, 2e-3, depth, 0.0, False, 0.0))
    assert depth_went_on(seen)
    assert not depth_went_on(seen[:6])


@pytest.mark.parametrize(("gone_mm", "told"), [(0.7, False), (1.1, True)])
def test_depth_across_a_box_must_go_on_by_more(gone_mm: float, told: bool) -> None:
    """Its deviation of 0.14 mm, five times, and 0.25 mm."""
    deviation, seen = np.full(3, 1.4e-4), []
    for i in range(8):
        gone = np.array((0.0, 1e-3 * gone_mm if i > 5 else 0.0, 0.0))
        seen.append(Observation(i * PERIOD, np.zeros(3), 0.0, Depth(gone, deviation), 0.0, False, 0.0))
    assert depth_went_on(seen) == told
