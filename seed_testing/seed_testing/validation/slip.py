# SPDX-License-Identifier: Apache-2.0
"""Gross slip with ground truth: the tool is pulled until friction gives way; the estimator should say so at once.

Rendered bubbles go with the tool as one body, under friction; membranes with mechanics are drawn anew for each pull.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from joblib import delayed

from seed_core.errors import FailedError
from seed_core.spatial import Array, make_pose, so3_exp
from seed_estimation import TactileImages
from seed_sim.bubble_renderer import HeldRenderer, renderer_of
from seed_sim.closed_loop.progress import in_parallel
from seed_sim.membrane import MembraneError
from seed_sim.scenario import Scenario, on_membrane, tactile_of
from seed_sim.tactile import TactileRenderer
from seed_sim.tactile.friction import Friction, Held
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.tactile.trajectory import TrajectorySection, poses
from seed_testing.validation.run import estimator_for

IN_TIME = 0.1 + 1e-9  # [s] from the onset of a slip to its alarm; stamps add up with rounding
_AFTER = 0.25  # [s] of images after the onset
_LONGEST = 6.0  # [s] until the slowest pull has overcome the firmest grip
_PIECE = 60.0  # [s] of ordinary manipulation per grasp
_BLOCK, _BEYOND = 500, 10**15  # slips, and calm pieces, whose seeds lie together; what lies between two such blocks
_SUBSTEPS = 10  # of friction per pair of images
# ordinary manipulation moves the tool about half as far as the combined trajectory
_ORDINARY = TrajectorySection(translation_mm=(2.2, 1.0, 1.5), rotation_deg=(4.0, 3.0, 3.0))
_HOLD = 0.009  # [m] grip in ordinary manipulation
# Membranes: share of the touching nodes that slide when nearly all do, solves per pair of images, [m] between nodes,
# and share of the ordinary motion that a light grip bears
_ALL, _SUBSOLVES, _SPACING, _BORNE = 0.95, 2, 0.006, 0.4
_LEVEL = 0.1  # of its largest rise with the way pulled, at which the load has come to its plateau: the tool slides


class Pull(NamedTuple):
    """A slip: from `start` [s] on the tool is pulled at `speed` (6,) [rad/s, m/s] until a grip that holds up to `hold`
    [m] gives way; `kinetic` is the share that it keeps then."""

    start: float
    speed: Array
    hold: float
    kinetic: float

    def pulled(self, t: float) -> Array:
        """How far (4, 4) at time t."""
        elapsed = max(0.0, t - self.start)
        return make_pose(so3_exp(self.speed[:3] * elapsed), self.speed[3:] * elapsed)


def random_pull(rng: np.random.Generator) -> Pull:
    """Along z or x at 30 to 100 mm/s, or turning about y at 1 to 3 rad/s; grip and time at random."""
    speed, kind, sign = np.zeros(6), int(rng.integers(0, 3)), float(rng.choice((-1.0, 1.0)))
    if kind == 2:
        speed[1] = sign * rng.uniform(1.0, 3.0)
    else:
        speed[5 if kind == 0 else 3] = sign * rng.uniform(0.03, 0.1)
    start, hold, kinetic = (float(rng.uniform(*bounds)) for bounds in ((1.5, 3.0), (0.0065, 0.010), (0.6, 0.9)))
    return Pull(start, speed, hold, kinetic)


class Moment(NamedTuple):
    """A pair of images' time [s], the tool's pose, what friction does, and since when the tool slides (inf: not)."""

    stamp: float
    X_CT: Array
    held: Held
    onset: float


def moments(
    p: TactileParameters, reach: float, section: TrajectorySection, pull: Pull | None, seed: int
) -> Iterator[Moment]:
    """Ordinary manipulation under the friction of p, with a pull on top of it if there is one."""
    friction, onset = Friction(p.hold, p.kinetic, reach), np.inf
    fine = replace(section, rate=section.rate * _SUBSTEPS)
    for i, (t, X) in enumerate(poses(fine, seed), start=1):
        X_CT = X if pull is None else X @ pull.pulled(t)
        held = friction.step(X_CT, t)
        onset = min(onset, t) if held.sliding else onset
        if i % _SUBSTEPS == 0:
            yield Moment(t, X_CT, held, onset)


class Frame(NamedTuple):
    """Images of one time [s], since when the tool slides (inf: not), since when nearly all that touches it does, and
    whether it does now."""

    stamp: float
    images: dict[str, TactileImages]
    onset: float
    all_slide: float
    sliding: bool


def rendered(
    renderer: TactileRenderer, section: TrajectorySection, pull: Pull | None, seed: int, p: TactileParameters
) -> Iterator[Frame]:
    """Frames of a tool that friction of p holds as one body."""
    for m in moments(p, renderer.reach, section, pull, seed):
        images = renderer.render(m.X_CT, m.stamp, m.held.X_slid, m.held.load)
        yield Frame(m.stamp, images, m.onset, m.onset, m.held.sliding)


class Plateau:
    """The load of a pull: from when it hardly rises on, the tool slides.

    Unlike a share of the nodes that slide, that holds for turns, too: the node at the pivot never slides.

    Attributes:
        since: [s] (inf: the load rises still).
    """

    def __init__(self, pull: Pull | None) -> None:
        self.since = math.inf
        self._start = pull.start if pull is not None else math.inf
        self._along = pull.speed / np.linalg.norm(pull.speed) if pull is not None else np.zeros(6)
        self._last: tuple[float, float] | None = None
        self._steepest = 0.0

    def add(self, t: float, wrench: Array) -> None:
        """wrench (6,): of the membranes on the tool at time t [s], in T (torque, force)."""
        if t < self._start:
            return
        load = -float(self._along @ wrench)
        if self._last is not None:
            rise = (load - self._last[1]) / (t - self._last[0])
            self._steepest = max(self._steepest, rise)
            if rise < _LEVEL * self._steepest:
                self.since = min(self.since, t)
        self._last = t, load


def on_membranes(renderer: HeldRenderer, section: TrajectorySection, pull: Pull | None, seed: int) -> Iterator[Frame]:
    """Frames of a tool between membranes with mechanics."""
    all_slide, load = math.inf, Plateau(pull)
    fine = replace(section, rate=section.rate * _SUBSOLVES)
    for i, (t, X) in enumerate(poses(fine, seed), start=1):
        X_CT = X if pull is None else X @ pull.pulled(t)
        state = renderer.hold.at(X_CT, t)
        sliding = state.sliding_share > _ALL
        load.add(t, state.wrench.vector())
        all_slide = min(all_slide, t) if sliding else all_slide
        if i % _SUBSOLVES == 0:
            yield Frame(t, renderer.render(X_CT, t), load.since, all_slide, sliding)


def watched(
    scenario: Scenario, seed: int, pull: Pull | None, duration: float
) -> tuple[TactileRenderer | HeldRenderer, Iterator[Frame]]:
    """The renderer of a run, and its frames: ordinary manipulation with a pull on top of it if there is one."""
    cv2.setNumThreads(1)
    section = replace(_ORDINARY, duration=duration)
    if scenario.grasp.kind == "membrane":
        drawn = on_membrane(scenario, seed)
        drawn = replace(drawn, membrane=replace(drawn.membrane, spacing=_SPACING))
        held = renderer_of(drawn, seed)
        assert isinstance(held, HeldRenderer)
        return held, on_membranes(held, replace(section, scale=_BORNE), pull, seed)
    p = replace(tactile_of(scenario), hold=_HOLD)
    if pull is not None:
        p = replace(p, hold=pull.hold, kinetic=pull.kinetic)
    renderer = TactileRenderer(p, scenario.hand, seed)
    return renderer, rendered(renderer, section, pull, seed, p)


class Told(NamedTuple):
    """What a slip came to: seconds from its onset to the alarm, and to the first estimate that is not valid, be it by
    the alarm or by a track that is lost (None: never); seconds by which an alarm came too early (None: it did not);
    seconds from when nearly all that touches slides to the alarm (negative: it came before)."""

    alarm: float | None = None
    invalid: float | None = None
    early: float | None = None
    after_all: float | None = None


def alarm_delay(scenario: Scenario, seed: int) -> Told:
    """How a pull drawn from the seed is told."""
    pull = random_pull(np.random.default_rng((seed, 5)))
    renderer, frames = watched(scenario, seed, pull, _LONGEST)
    estimator = estimator_for(scenario, "rigid_fit", renderer)
    invalid = alarm = None
    onset = all_slide = math.inf
    try:
        for frame in frames:
            onset, all_slide = frame.onset, frame.all_slide
            if alarm is None:
                estimate = estimator.update(frame.images, frame.stamp)
                alarm = frame.stamp if estimate.gross_slip else None
                if frame.stamp >= onset and not estimate.valid and invalid is None:
                    invalid = frame.stamp - onset
            if frame.stamp - onset > _AFTER or (alarm is not None and max(onset, all_slide) < math.inf):
                break
    except MembraneError:  # torn out of the grasp
        pass
    if alarm is None:
        return Told(None, invalid)
    if alarm < onset:
        return Told(None, invalid, onset - alarm, alarm - all_slide)
    return Told(alarm - onset, invalid, None, alarm - all_slide)


def false_alarms(scenario: Scenario, seed: int, duration: float) -> tuple[int, int, int]:
    """Alarms in so many seconds of ordinary manipulation without slip, valid estimates, and frames.

    The grasp is taken anew after an alarm, as an operator would; on membranes, where that would be another grasp, a
    piece ends with it. So it does where drawn membranes do not bear the motion, as soon as the tool slides.

    Raises:
        SeedError: a tool between bubbles without mechanics slid after all.
    """
    renderer, images = watched(scenario, seed, None, duration)
    estimator = estimator_for(scenario, "rigid_fit", renderer)
    alarms = valid = frames = 0
    for frame in images:
        if frame.sliding:
            if isinstance(renderer, HeldRenderer):
                break
            raise FailedError(f"ordinary motion of seed {seed} slides at {frame.stamp:.2f} s: the grip is too weak")
        estimate = estimator.update(frame.images, frame.stamp)
        frames, valid = frames + 1, valid + estimate.valid
        if estimate.gross_slip:
            alarms += 1
            if isinstance(renderer, HeldRenderer):
                break
            estimator = estimator_for(scenario, "rigid_fit", renderer)
    return alarms, valid, frames


def drawn_from(seed: int, i: int, calm: bool = False) -> int:
    """The seed of slip or calm piece i; no two are the same, nor those of another seed."""
    block, within = divmod(i, _BLOCK)
    return 2 * _BLOCK * seed + _BLOCK * calm + within + _BEYOND * block


def alarms(scenario: Scenario, seed: int, slips: int, minutes: float, jobs: int) -> dict[str, Any]:
    """Share of slips that raise the alarm within 100 ms, and false alarms, in so many processes."""
    pieces = max(1, math.ceil(minutes * 60.0 / _PIECE))
    duration = max(minutes * 60.0 / pieces, 1.0)
    work = [delayed(alarm_delay)(scenario, drawn_from(seed, i)) for i in range(slips)]
    work += [delayed(false_alarms)(scenario, drawn_from(seed, i, calm=True), duration) for i in range(pieces)]
    results: list[Any] = list(in_parallel(work, min(jobs, len(work)), "run"))
    found, calm = results[:slips], np.array(results[slips:])
    delays = [told.alarm for told in found if told.alarm is not None]
    early = [told.early for told in found if told.early is not None]
    after_all = [told.after_all for told in found if told.after_all is not None]
    held = [told.invalid for told in found if told.invalid is not None]
    wrong, valid, frames = calm.sum(axis=0).tolist()
    return {
        "scenario": scenario.name,
        "grasp": scenario.grasp.kind,
        "seed": seed,
        "slips": slips,
        "alarm_fraction": sum(d <= IN_TIME for d in delays) / max(slips, 1),
        "alarm_delay_ms": {
            "median": 1e3 * float(np.median(delays)) if delays else None,
            "max": 1e3 * max(delays) if delays else None,
        },
        "alarm_fraction_after_all_slide": sum(0.0 <= d <= IN_TIME for d in after_all) / max(slips, 1),
        "early_alarms": len(early),
        "early_within_100_ms": sum(d <= IN_TIME for d in early),
        "invalid_fraction": sum(d <= IN_TIME for d in held) / max(slips, 1),
        "minutes": frames / _ORDINARY.rate / 60.0,
        "false_alarms": wrong,
        "valid_fraction": valid / max(frames, 1),
    }
