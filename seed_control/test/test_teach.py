# SPDX-License-Identifier: Apache-2.0
"""A demonstration becomes a task that goes the same way with the same forces; what is none is refused by name."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seed_control.parameters import ControllerParameters
from seed_control.tasks import Task
from seed_control.tasks.steps import steps_of
from seed_control.teach import Demonstration, Recorder, TeachError, TeachSettings, make_task, task_text
from seed_control.teach.compare import _away as away_from
from seed_control.teach.compare import difference, force_at
from seed_control.teach.make import _Maker
from seed_control.teach.pieces import corners, levels, rested, speed_of
from seed_core.config import ConfigError, load_text
from seed_core.spatial import make_pose

SURFACE = make_pose(Rotation.from_euler("xyz", (4.0, -3.0, 0.0), degrees=True).as_matrix(), (0.45, 0.02, 0.01))
CORNERS = np.array(((0.0, 0.0), (0.1, 0.0), (0.1, 0.06)))  # [m] of the path, in the surface
FORCES, FRICTION, SPEED, RATE = (8.0, 5.0), 0.3, 0.04, 30.0


def shown(noise: float = 1.0, seed: int = 0) -> Demonstration:
    """Down from 30 mm, press with 8 N along the first leg and 5 N along the second, up again; friction pulls back."""
    rng = np.random.default_rng(seed)
    rows = []  # place in the surface's frame, force in it

    def go(a: tuple[float, ...], b: tuple[float, ...], duration: float, press: tuple[float, float]) -> None:
        for s in np.arange(0.0, 1.0, 1.0 / (RATE * duration)):
            v = (np.array(b) - a) * (1.0, 1.0, 0.0)
            size = press[0] + s * (press[1] - press[0])
            along = v / max(np.linalg.norm(v), 1e-9)
            rows.append(((1 - s) * np.array(a) + s * np.array(b), size * (FRICTION * along - (0.0, 0.0, 1.0))))

    o, m, e = ((*c, 0.0) for c in CORNERS)
    up, high = (0.0, 0.0, 0.03), (*CORNERS[2], 0.04)
    go(up, o, 1.0, (0.0, 0.0))
    go(o, o, 0.4, (0.0, FORCES[0]))
    go(o, m, 0.1 / SPEED, (FORCES[0], FORCES[0]))
    go(m, m, 0.2, FORCES)
    go(m, e, 0.06 / SPEED, (FORCES[1], FORCES[1]))
    go(e, e, 0.2, (FORCES[1], 0.0))
    go(e, high, 1.2, (0.0, 0.0))
    p, f = (np.array(v) for v in zip(*rows, strict=True))
    R = SURFACE[:3, :3]
    X = np.tile(np.eye(4), (len(p), 1, 1))
    X[:, :3, 3] = p @ R.T + SURFACE[:3, 3] + 3e-4 * noise * rng.standard_normal(p.shape)
    down = Rotation.from_euler("xyz", (180.0, 0.0, 0.0), degrees=True)
    trembling = Rotation.from_rotvec(0.01 * noise * rng.standard_normal(p.shape))
    X[:, :3, :3] = (Rotation.from_matrix(R) * down * trembling).as_matrix()
    stamps = 1.7e9 + np.arange(len(p)) / RATE
    return Demonstration(stamps, X, f @ R.T + 0.1 * noise * rng.standard_normal(p.shape))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_task_goes_the_way_that_was_shown_with_its_forces_on_the_surface_that_was_pressed(seed: int) -> None:
    made = make_task(shown(seed=seed), "mine", "squeegee")
    assert made.forces == pytest.approx(FORCES, abs=0.15)
    X = made.task.frame.pose
    assert np.rad2deg(np.arccos(X[:3, 2] @ SURFACE[:3, 2])) < 1.0
    wiped = [s for s in steps_of(made.task) if s.phase.name.startswith("wipe")]
    path = np.concatenate([np.array(s.points) for s in wiped])
    places = ((path @ X[:3, :3].T + X[:3, 3]) - SURFACE[:3, 3]) @ SURFACE[:3, :3]
    far = [min(_away(q, a, b) for a, b in pairwise(CORNERS)) for q in places[:, :2]]
    assert max(far) < 1e-3
    for corner in CORNERS[1:]:  # both are passed
        assert np.linalg.norm(places[:, :2] - corner, axis=1).min() < 2e-3
    steps = steps_of(made.task)
    ways = [(s.phase, np.array([before.points[-1], *s.points])) for before, s in pairwise(steps) if s in wiped]
    times = [np.linalg.norm(np.diff(way, axis=0), axis=1).sum() / phase.speed for phase, way in ways]
    assert sum(times) == pytest.approx(0.16 / SPEED, rel=0.2)
    assert len(path) <= 12
    tip = X[:3, :3] @ Rotation.from_euler("xyz", made.task.tip_rpy, degrees=True).as_matrix()
    assert np.linalg.norm(tip[:, 2] + SURFACE[:3, 2]) < 0.02  # the tool points into the surface


def test_a_force_that_wavers_is_taught_as_it_was_pressed() -> None:
    even = shown()
    times = even.stamps - even.stamps[0]
    waver = 1.0 + 0.08 * np.sin(2.0 * np.pi * 0.6 * (times - 1.4))  # from the start of the first leg on
    made = make_task(replace(even, forces=even.forces * waver[:, None]), "mine", "squeegee", TeachSettings(force=1.0))
    first = next(p for p in made.task.phases if p.name.startswith("wipe"))
    assert first.control is not None
    leg = np.linspace(0.05, 0.55, 11)  # of the path of both legs: the first alone
    pressed = [-first.control.force[2] * first.control.share_at(s) for s in leg]
    true = FORCES[0] * (1.0 + 0.08 * np.sin(2.0 * np.pi * 0.6 * leg * 0.16 / SPEED))
    off = np.sqrt(np.mean(np.square(pressed - true)))
    assert off < 0.2, pressed  # 0.45 N with one force
    text = task_text(made.task)
    assert "profile:" in text
    assert load_text(text, Task, "mine.yaml") == made.task


def _away(q: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    s = np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return float(np.linalg.norm(q - a - s * (b - a)))


def test_a_tool_that_touches_while_it_stands_comes_down_where_it_presses() -> None:
    """Friction keeps a tip where it lands, so what is off there is off until the tip slides."""
    d = shown(seed=3)
    touched = np.flatnonzero(np.linalg.norm(d.forces, axis=1) > 1.0)[:4]
    X = d.X_W_tip.copy()
    X[touched, :3, 3] += 0.0015 * SURFACE[:3, 1]  # it skids by 1.5 mm as it comes down
    task = make_task(Demonstration(d.stamps, X, d.forces), "mine", "").task
    landing = next(p for p in task.phases if p.name == "approach").to
    assert landing is not None
    place = SURFACE[:3, :3].T @ (task.frame.pose @ np.append(landing, 1.0) - np.append(SURFACE[:3, 3], 0.0))[:3]
    np.testing.assert_allclose(place[:2], CORNERS[0], atol=7e-4)


def test_a_blade_that_gives_way_to_friction_aims_by_as_much_further() -> None:
    """Across its axis it gives way by F / side_stiffness; a pen, which torque does not turn, does not."""
    d = shown(noise=0.0)
    further = {}
    for tool, axes in (("squeegee", ("x",)), ("pen", ())):
        maker = _Maker(d.even(), TeachSettings(resists=axes))
        further[tool] = SURFACE[:3, :3].T @ maker._X_W[:3, :3] @ (maker._aim - maker._p).T
    expected = FRICTION * FORCES[1] / ControllerParameters().side_stiffness  # on the second leg, along y
    assert further["squeegee"][1].max() == pytest.approx(expected, rel=0.1)
    assert np.abs(further["squeegee"][[0, 2]]).max() < 0.05 * expected
    assert not further["pen"].any()


def test_pieces_of_a_way_on_which_the_tool_turns_have_names_of_their_own() -> None:
    d = shown(noise=0.0)
    X, s = d.X_W_tip.copy(), np.linspace(0.0, 1.0, len(d.stamps))
    X[:, :3, :3] = (d.rotations * Rotation.from_rotvec(np.outer(np.sin(15.0 * s), (0.0, 0.3, 0.0)))).as_matrix()
    task = make_task(replace(d, X_W_tip=X), "mine", "").task
    names = [p.name for p in task.phases]
    assert "wipe 2" in names
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("speed", [0.0, 0.005, 0.05])
def test_a_tip_that_stands_is_at_one_place_and_one_that_moves_slowly_stays_on_its_path(speed: float) -> None:
    t = np.arange(100) * 0.02
    noise = 3e-4 * np.random.default_rng(0).standard_normal((100, 2))
    path = np.column_stack((speed * t, 0.0 * t))
    out = rested(path + noise, 0.0015, 15)
    assert np.abs(out[:, 1]).max() <= np.abs(noise[:, 1]).max()
    if not speed:
        assert np.ptp(out, axis=0).max() == 0.0
    assert np.linalg.norm(out - path, axis=1).max() < 0.0025


@pytest.mark.parametrize("away", [0.0, 0.9])
def test_the_file_says_what_the_task_is(away: float) -> None:
    there = shown()
    X = there.X_W_tip.copy()
    X[:, 0, 3] += away  # beyond a metre from the base, too
    task = make_task(replace(there, X_W_tip=X), "mine", "pen", TeachSettings(resists=("x",))).task
    text = task_text(task, "a comment")
    assert text.startswith("# a comment\nname: mine\n")
    assert load_text(text, Task, "mine.yaml") == task
    assert "torque_axes: [x]" in text
    assert task.phases[0].name == "begin"
    assert [p.name for p in task.phases[-2:]] == ["release", "leave"]
    assert all(p.speed <= 0.03 for p in task.phases if p.name == "release")


def test_where_nothing_is_touched_the_path_alone_is_taught() -> None:
    d = shown()
    task = make_task(Demonstration(d.stamps, d.X_W_tip, 0.0 * d.forces), "free", "").task
    assert all(p.control is None for p in task.phases)
    way = np.concatenate([np.array(s.points) for s in steps_of(task)]) @ task.frame.pose[:3, :3].T
    assert np.linalg.norm(way[-1] + task.frame.pose[:3, 3] - d.X_W_tip[-1, :3, 3]) < 2e-3


def _changed(change: Callable[[np.ndarray, np.ndarray, np.ndarray], None]) -> Demonstration:
    d = shown()
    t, X, f = d.stamps.copy(), d.X_W_tip.copy(), d.forces.copy()
    change(t, X, f)
    return Demonstration(t, X, f)


def _gap(t: np.ndarray, *_: np.ndarray) -> None:
    t[60:] += 0.8


def _back(t: np.ndarray, *_: np.ndarray) -> None:
    t[60:] -= 1.0


def _slip(_: np.ndarray, X: np.ndarray, *__: np.ndarray) -> None:
    X[70:, 0, 3] += 0.04


def _turn(_: np.ndarray, X: np.ndarray, *__: np.ndarray) -> None:
    X[70:, :3, :3] = X[70:, :3, :3] @ Rotation.from_euler("z", 20.0, degrees=True).as_matrix()


def _kick(*arrays: np.ndarray) -> None:
    arrays[2][70] += 25.0


def _unknown(*arrays: np.ndarray) -> None:
    arrays[2][3, 1] = np.nan


def _pushed(*arrays: np.ndarray) -> None:
    arrays[2][:] = np.abs(arrays[2][:, 2:]) * SURFACE[:3, 0]  # along the first leg


def _pulled(*arrays: np.ndarray) -> None:
    arrays[2][:] *= -1.0


def _collapsed(_: np.ndarray, X: np.ndarray, *__: np.ndarray) -> None:
    X[70, :3, :3] = 0.0


def _in_millinewtons(*arrays: np.ndarray) -> None:
    arrays[2][:] *= 1e3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_pulled, r"the force of \d\.\d N pulls towards where the tool came from: only pressing can be taught"),
        (_collapsed, "the pose of measurement 71 has no rotation"),
        (_in_millinewtons, r"is \d\.\d+e\+03 N, at most 200 N can be taught: is it in newtons"),
        (_gap, r"gap of 0\.8\d s after 1\.9\d s, at most 0\.3 s: the estimator lost the tool"),
        (_back, "time goes backwards after 1.97 s"),
        (_slip, r"the tip jumps by 4\d\.\d mm within 0\.033 s, 2\.30 s after the start"),
        (_turn, r"rotation jumps by (19|20|21)\.\d degrees"),
        (_kick, r"the force jumps by \d\d\.\d N"),
        (_unknown, "the force of measurement 4 is not a number"),
        (_pushed, "press across the path"),
    ],
)
def test_a_demonstration_that_cannot_be_believed_is_refused_by_name(change: Callable[..., None], words: str) -> None:
    with pytest.raises(TeachError, match=words):
        make_task(_changed(change), "mine", "")


def test_too_little_is_no_demonstration() -> None:
    d = shown()
    with pytest.raises(TeachError, match=r"lasts 0\.\d s; at least 1 s"):
        make_task(Demonstration(d.stamps[:20], d.X_W_tip[:20], d.forces[:20]), "mine", "")
    for few in (0, 3):
        with pytest.raises(TeachError, match=f"has {few} measurements; at least 10"):
            make_task(Demonstration(d.stamps[:few], d.X_W_tip[:few], d.forces[:few]), "mine", "")
    with pytest.raises(TeachError, match="nothing was measured"):
        Recorder().demonstration()
    with pytest.raises(ConfigError, match="resists has 'q'"):
        TeachSettings(resists=("q",))


def test_an_image_counts_once_and_standing_before_and_after_is_left_out() -> None:
    recorder, d = Recorder(), shown(noise=0.0)
    waiting = [(d.stamps[0] - 3.0 + k / RATE, 0) for k in range(90)]
    for stamp, k in [*waiting, *((s, i) for i, s in enumerate(d.stamps))]:
        for late in (0.0, 1e-7):  # the same image in two messages
            recorder.add(stamp + late, d.X_W_tip[k], d.forces[k])
    assert len(recorder) == 90 + len(d.stamps)
    moving = recorder.demonstration().moving()
    assert d.stamps[0] - 1.1 < moving.stamps[0] <= d.stamps[0]
    assert moving.stamps[-1] == d.stamps[-1]


@pytest.mark.parametrize("tolerance", [1e-4, 1e-3, 1e-2])
def test_no_point_is_farther_from_the_corners_polyline_than_the_tolerance(tolerance: float) -> None:
    s = np.linspace(0.0, 6.0, 200)
    curve = np.column_stack((0.1 * np.cos(s), 0.1 * np.sin(s), 0.01 * s))
    kept = corners(curve, tolerance)
    assert (kept[0], kept[-1]) == (0, 199)
    for a, b in pairwise(kept):
        assert max(_away(curve[i], curve[a], curve[b]) for i in range(a, b + 1)) <= tolerance + 1e-12
    # an arc of radius r needs chords of 2 sqrt(2 r tolerance), and the method is at most twice as fine
    chords = 0.6 / (2.0 * np.sqrt(2.0 * 0.1 * tolerance))
    assert 0.8 * chords < len(kept) - 1 < 2.5 * chords + 2


def test_a_rising_force_is_taught_in_steps_within_the_band() -> None:
    force = np.concatenate((np.linspace(0.0, 4.0, 10), np.linspace(4.0, 8.0, 300), np.linspace(8.0, 0.0, 10)))
    pieces = levels(force, 0.4, 25)
    assert 4 <= len(pieces) <= 6
    for piece in pieces:
        assert np.ptp(force[piece.there : piece.end]) <= 2.0 * 0.4 + 0.02
    assert pieces[0].there > 5
    assert pieces[-1].end <= 312


@pytest.mark.parametrize("tap", [(0.0, 2.0, 9.0, 9.0), (0.0, 5.0, 0.0), (0.0, 3.0, 6.0, 9.0, 6.0, 3.0, 0.0)])
def test_a_tap_that_is_too_short_for_a_level_is_one_piece(tap: tuple[float, ...]) -> None:
    (piece,) = levels(np.array(tap), 0.4, 25)
    assert 0 <= piece.start <= piece.there < piece.end <= len(tap)
    assert 0.0 < piece.size <= max(tap)


def test_a_speed_takes_the_time_that_was_shown() -> None:
    v = speed_of(0.1, 2.5, 0.2, 1e-3, 0.25)
    assert 0.1 / v + v / 0.2 == pytest.approx(2.5)
    assert speed_of(0.1, 0.5, 0.2, 1e-3, 0.25) == pytest.approx(np.sqrt(0.2 * 0.1))  # as fast as that acceleration can


def test_corners_without_an_end_are_refused() -> None:
    text = "name: a\nphases: [{name: b, through: [[0, 0, 0]]}]\n"
    with pytest.raises(ConfigError, match="through needs to"):
        load_text(text, Task, "a.yaml")


def test_paths_are_compared_between_their_samples_too() -> None:
    """A path 2 mm aside is 2 mm away, wherever the samples of both happen to lie."""
    path = np.column_stack((np.arange(0.0, 0.1, 0.01), np.zeros(10)))
    np.testing.assert_allclose(away_from(path[:-1] + np.array((0.0033, 0.002)), path), 0.002)


def _gap_of(apart: float) -> float:
    d = shown(noise=0.0)
    X = d.X_W_tip.copy()
    X[:, :3, 3] += apart * SURFACE[:3, 1]
    return difference(d, Demonstration(d.stamps, X, d.forces)).path_max


def test_the_difference_is_that_of_a_leg_shifted_aside() -> None:
    assert _gap_of(0.0) == 0.0
    assert _gap_of(0.002) == pytest.approx(0.002, rel=0.15)


def test_where_a_tip_stands_any_force_that_it_pressed_with_there_is_the_force_of_that_place() -> None:
    """A tip that stood for a second has no one sample nearest to a place: their mean counts."""
    p, f = np.zeros((50, 2)), np.concatenate((np.full(5, 7.0), np.full(45, 9.0)))
    np.testing.assert_allclose(force_at(p, f, np.array(((1e-5, 0.0), (0.003, 0.0)))), np.mean(f))
