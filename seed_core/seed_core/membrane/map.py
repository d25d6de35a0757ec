# SPDX-License-Identifier: Apache-2.0
"""The wrench from the membranes: an identified, smooth function of what their material does (docs/membrane_map.md).

Tool and membrane may slide on each other; the free membrane between patch and rim stays elastic. So the load is a
function of the material's motion alone, without history, and that function is a sum of products of features. It is
written in C, where the rims of the membranes stand still, and turned into T in the end:

    w_C = sum_k c_k t_k(z),    torque_T = R_TC torque_C + p_TC x R_TC force_C,    force_T = R_TC force_C
"""

from __future__ import annotations

from math import isfinite
from pathlib import Path

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.config import ConfigError
from seed_core.estimate import DEFORMATIONS, MembraneMotion, RelativePoseEstimate
from seed_core.hand import FINGERS
from seed_core.membrane.features import (
    COUNT,
    NAMES,
    RIGID,
    SCALE,
    SCALES,
    STICKING,
    FeatureError,
    Motions,
    by_finger,
    feature_covariance,
    gripper_rates,
    mixed,
    of_finger,
)
from seed_core.membrane.map_file import MOST_FACTORS, GripMap, MembraneMapFile, format_rows, load_membrane_map
from seed_core.spatial import Array, Wrench, both, inverse_pose, skew, so3_log, wrench_adjoint
from seed_core.wrench_model import SpringWrench, observed_part

BEYOND = 1.5  # times what was identified, in any rigid feature, is outside; of the leverage its square
LEAST_STIFFNESS = 0.2  # share of the stiffness at rest; below it the law would command without bound
# By which a new grasp is off, since its band is found a pixel or two elsewhere: share of each load, and lever [m]
GRASPED, LEVER = 0.01, 0.0012
# Share of the motions' variance that counts: what mounts, lens and range err by, the identification has learned
UNLEARNED = 0.25
STILL = 0.1  # share of the residual's variance that small motions have
LEAST_RANGE = 0.2  # [scale] of a feature that the identification hardly moved
AT_REST, LIGHT = 0.15, 0.6  # [scales] of motion that counts as none, and of a tool that merely hangs in the grasp
FOLLOWED = 0.04  # share by which the pressures at the grasp follow in each estimate at rest: a new grasp creeps
OFF_PRESSURE = 0.03  # a pressure off the identified ones by more than this share is of another grip, membrane or unit
RIGID_INDICES = [i for i, name in enumerate(NAMES) if name[:-1] in RIGID]
_DIAGONAL, _TORQUE = np.diag_indices(6), np.diag_indices(3)
PRESSURES = [i for i, name in enumerate(NAMES) if name.startswith("pressure")]
_PRESSURE_SIGMAS, _LEAST_RISE = 6.0, 0.25  # off by more than both, in deviations and in scales, is a contradiction
_AMBIENT, _UNITS = 1013.25, (("Pa", 0.01), ("kPa", 10.0), ("bar", 1000.0), ("psi", 68.948))


class MembraneMap:
    """The map at one grip.

    Attributes:
        name: 'membrane'.
    """

    name = "membrane"

    def __init__(self, file: MembraneMapFile, grip: GripMap | None = None) -> None:
        """At a grip of the file, its middle one if none is given."""
        self.file = file
        self.grip = file.grips[len(file.grips) // 2] if grip is None else grip
        self._middles = self.grip.middles
        self._products, self._coefficients = file.products, self.grip.matrix
        self._follow = self.grip.follow_matrix
        self._gas, self._gas_std = self.grip.pressure_matrix, np.array(self.grip.pressure_std)
        self.reset()
        self._spread, self._variance = self.grip.spread_matrix, self.grip.std**2
        self._largest = np.array(file.largest)
        self._stacked = np.vstack([self._coefficients, self._gas])  # (6 or 8, terms)
        feature = self._products.T.ravel()  # of each factor of each term
        order = np.argsort(feature, kind="stable")
        self._order = order[feature[order] < COUNT]
        self._ordered = np.tile(self._stacked, MOST_FACTORS)[:, self._order]
        self._moved, self._starts = np.unique(feature[self._order], return_index=True)
        at_rest = tuple(MembraneMotion(f, np.eye(4), deformation=np.zeros(DEFORMATIONS)) for f in FINGERS)
        _, slopes = self._terms(np.zeros(COUNT))
        self._rest = self._local_stiffness(np.eye(4), np.zeros(6), slopes, by_finger(at_rest))
        if not (self._rest > 0.0).all():
            raise ConfigError(
                f"membrane map: stiffness at rest {np.round(self._rest, 3).tolist()} N m/rad, N/m must be > 0: "
                "identify again"
            )
        self._last: tuple[Array, Array, Array, Motions] | None = None

    @classmethod
    def load(cls, path: str | Path) -> MembraneMap:
        """From a file, at its middle grip. Raises ConfigError."""
        return cls(load_membrane_map(path))

    def reset(self) -> None:
        """The tool is grasped anew: pressures count from those of this grasp."""
        self._at_grasp: Array | None = None  # (2,) [hPa]
        self._expected = np.zeros(2)  # [hPa] rises, left and right, as the motion has them
        self._resting = np.zeros((2, 6))  # [scales] where both membranes have been of late
        self._before = self._memory

    def take_back(self) -> None:
        """The newest estimate was none: as if `spring` had not been told of it."""
        self._at_grasp, self._expected, self._resting = self._before

    @property
    def _memory(self) -> tuple[Array | None, Array, Array]:
        return self._at_grasp, self._expected, self._resting

    def at_width(self, width: float) -> MembraneMap:
        """The map at a gripper width [m]: straight between the grips identified, constant beyond them."""
        if not isfinite(width):
            raise ConfigError(f"width = {width} m must be finite")
        out = MembraneMap(self.file, _between(self.file.grips, [-g.width_m for g in self.file.grips], -width))
        out._at_grasp, out._expected, out._resting = out._before = self._memory
        return out

    def spring(self, estimate: RelativePoseEstimate) -> SpringWrench:
        """The load of the membranes on the tool; without their motion a covariance that is not finite, and why."""
        self._before = self._memory
        try:
            motions = by_finger(estimate.membrane)
            left, right = (of_finger(m, p) for m, p in zip(motions, self._middles, strict=True))
            rises = self._rises(motions, (left, right))
        except FeatureError as error:
            return SpringWrench(Wrench.zero(), np.full((6, 6), np.inf), f"no wrench from the membranes: {error}")
        if rises is not None:
            left[-1], right[-1] = rises
        z = mixed(left, right)
        terms, slopes = self._terms(z)
        w_C, leverage = self._coefficients @ terms, self._spread @ terms
        squared = float(leverage @ leverage)
        covariance = UNLEARNED * slopes[:6] @ feature_covariance(motions, self._middles) @ slopes[:6].T
        covariance[_DIAGONAL] += self._variance * (self._growth(z) + squared) + (GRASPED * w_C) ** 2
        covariance[_TORQUE] += LEVER**2 * float(w_C[3:] @ w_C[3:])
        X_TC = inverse_pose(observed_part(estimate))
        self._last = X_TC, w_C, slopes, motions
        to_T = wrench_adjoint(X_TC)
        doubt = max(1.0, self._growth(z) + squared)
        reason = self._beyond(z, squared) or self._of_pressure(motions, None if rises is None else z, terms, doubt)
        return SpringWrench(Wrench.from_vector(to_T @ w_C), to_T @ covariance @ to_T.T, reason)

    @property
    def stiffness(self) -> Stiffness:
        """d wrench / d motion of the gripper, diagonal, at the estimate that `spring` saw last; at rest before that."""
        if self._last is None:
            return Stiffness.from_vector(self._rest)
        return Stiffness.from_vector(np.maximum(self._local_stiffness(*self._last), LEAST_STIFFNESS * self._rest))

    def _growth(self, z: Array) -> float:
        """Of the residual's variance with the square of the motion, 1 at the mean of what was identified."""
        still = z[STICKING]
        return max(STILL, float(still @ still) / self.file.motion) if self.file.motion > 0.0 else 1.0

    def grasped(self, left: float, right: float) -> None:
        """Pressures [hPa] at the grasp, from which rises count; else they are those seen while nothing moves."""
        self._at_grasp = np.array([left, right])

    def _rises(self, motions: Motions, numbers: tuple[Array, Array]) -> Array | None:
        """(2,) [hPa] since the grasp; None where nobody measures them, or knows them at the grasp.

        numbers: (16,) of each finger, as `of_finger` has them.
        """
        pressures = np.array([m.pressure for m in motions])
        if not np.isfinite(pressures).all():
            if self.file.needs_pressure:
                raise FeatureError("the map was identified with the pressures of both bubbles; one is not measured")
            return None
        moved = np.array([of[:6] / SCALE[:6] for of in numbers])
        light = LIGHT if len(self._gas) else AT_REST  # how much a load raises them is known, or is not
        if self._at_grasp is None:
            if np.abs(moved).max() > AT_REST:
                if self.file.needs_pressure:
                    raise FeatureError("the pressures at the grasp are not known: initialise the grasp again")
                return None
            self._at_grasp = pressures
        elif np.abs(moved).max() < light and np.abs(moved - self._resting).max() < AT_REST:
            self._at_grasp = self._at_grasp + FOLLOWED * (pressures - self._expected - self._at_grasp)
        self._resting = self._resting + FOLLOWED * (moved - self._resting)
        return np.asarray(pressures - self._at_grasp)

    def _terms(self, z: Array) -> tuple[Array, Array]:
        """(terms,) of features (32,), and (6 or 8, 32) d w_C and d rises of pressure / d features."""
        factors = np.append(z, 1.0)[self._products]  # (terms, 3)
        a, b, c = factors.T
        others = np.concatenate((b * c, a * c, a * b))[self._order]
        slopes = np.zeros((len(self._stacked), COUNT))
        slopes[:, self._moved] = np.add.reduceat(self._ordered * others, self._starts, axis=1)
        return a * b * c, slopes

    def _local_stiffness(self, X_TC: Array, w_C: Array, slopes: Array, motions: Motions) -> Array:
        """(6,) diagonal of d w_T / d X_TC, in T, where patches stick and the membranes follow [N m/rad, N/m]."""
        moved = gripper_rates(motions, self._middles)
        if len(self._follow):
            moved = self._follow @ _tool_rates(inverse_pose(X_TC))
        if len(self._gas):  # the gas follows
            moved[PRESSURES] = slopes[6:] @ moved
        rates = slopes[:6] @ moved  # (6, 6) in C, for C's motion in C
        rates[:3, :3] -= skew(w_C[:3])  # the gripper's turn turns the load with it
        rates[3:, :3] -= skew(w_C[3:])
        return np.asarray(np.diag(wrench_adjoint(X_TC) @ rates @ both(X_TC[:3, :3]).T))

    def _beyond(self, z: Array, leverage: float) -> str:
        over = np.abs(z[RIGID_INDICES]) / np.maximum(self._largest[RIGID_INDICES], LEAST_RANGE)
        worst = RIGID_INDICES[int(over.argmax())]
        value, most = float(z[worst] * SCALES[worst]), float(self._largest[worst] * SCALES[worst])
        advice = "(rad, m): press less, or identify with larger poses"
        if over.max() > BEYOND:
            told = f"{NAMES[worst]} is {value:.3g}, identified up to {most:.3g}"
            return f"beyond the range of the membrane map: {told} {advice}"
        if leverage > BEYOND**2 * self.file.leverage:
            told = f"motions were not identified together ({NAMES[worst]} is {value:.3g} of {most:.3g}, the largest)"
            return f"beyond the range of the membrane map: {told} {advice}"
        return ""

    def _of_pressure(self, motions: Motions, z: Array | None, terms: Array, doubt: float) -> str:
        """Why a pressure is not to be believed; z is None where its rise is not known.

        doubt: of the variance of what is expected, over that at the identification's motions.
        """
        if not all(isfinite(m.pressure) for m in motions):
            return ""
        if self.grip.pressure_hpa > 0.0:
            reasons = [pressure_reason(m.finger, m.pressure, self.grip.pressure_hpa) for m in motions]
            if any(reasons):
                return next(r for r in reasons if r)
        if len(self._gas) == 0 or z is None:
            return ""
        expected = self._gas @ terms
        common, apart = SCALES[PRESSURES] * expected
        self._expected = np.array((common + apart, common - apart))
        seen, off = z[PRESSURES], np.abs(z[PRESSURES] - expected)
        if (off <= np.maximum(_PRESSURE_SIGMAS * doubt**0.5 * self._gas_std, _LEAST_RISE)).all():
            return ""
        stuck = "; it hardly changes: silent or stuck" if np.abs(seen).max() < 0.1 * np.abs(expected).max() else ""
        scale = SCALES[PRESSURES]
        return (
            f"the pressures do not go with the motion of the membranes: {np.round(scale * seen, 2).tolist()} hPa rise "
            f"in common and apart, {np.round(scale * expected, 2).tolist()} hPa expected{stuck}: check the sensors, "
            "look for a leak, or identify again"
        )


def pressure_reason(finger: str, pressure: float, identified: float) -> str:
    """Why an absolute pressure [hPa] does not go with the identified one; '' if it does."""
    if abs(pressure - identified) <= OFF_PRESSURE * identified:
        return ""
    hint = "another membrane, another grip, or a leak: identify again"
    if abs(pressure + _AMBIENT - identified) <= OFF_PRESSURE * identified:
        hint = "it looks like a pressure above the ambient one; the absolute one is needed"
    for unit, factor in _UNITS:
        if abs(pressure * factor - identified) <= OFF_PRESSURE * identified:
            hint = f"it looks like {unit}; hPa are needed"
    return (
        f"pressure of the {finger} bubble is {pressure:.4g} hPa; the grasp was identified at "
        f"{identified:.4g} hPa (at most {OFF_PRESSURE:.0%} off): {hint}"
    )


def _tool_rates(X_CT: Array) -> Array:
    """(6, 6) d [rotation vector, place of T] in C while C moves: by its turn [rad] and its origin's shift [m], in C."""
    out = -np.eye(6)
    out[:3, :3] += 0.5 * skew(so3_log(X_CT[:3, :3]))  # inverse left Jacobian, up to angle^2 / 12
    out[3:, :3] = skew(X_CT[:3, 3])
    return out


def _between(grips: tuple[GripMap, ...], keys: list[float], key: float) -> GripMap:
    """The grip at key, straight between the two beside it; keys rise."""
    above = next((i for i, k in enumerate(keys) if k >= key), len(keys) - 1)
    below = above - 1
    if below < 0 or key >= keys[-1]:
        return grips[above]
    s = (key - keys[below]) / (keys[above] - keys[below])
    return _mixed(grips[below], grips[above], s)


def _mixed(a: GripMap, b: GripMap, s: float) -> GripMap:
    """(1 - s) a + s b; the coefficients' covariances mix alike."""

    def mean(x: Array, y: Array) -> Array:
        return np.asarray((1.0 - s) * x + s * y)

    pressure = 0.0 if min(a.pressure_hpa, b.pressure_hpa) == 0.0 else (1.0 - s) * a.pressure_hpa + s * b.pressure_hpa
    (left, right), std = mean(a.middles, b.middles).tolist(), mean(a.std, b.std).tolist()
    return GripMap(
        pressure_hpa=pressure,
        pressure_rise=format_rows(mean(a.pressure_matrix, b.pressure_matrix))
        if a.pressure_rise and b.pressure_rise
        else (),
        pressure_std=tuple(mean(np.array(a.pressure_std), np.array(b.pressure_std)).tolist()),
        width_m=(1.0 - s) * a.width_m + s * b.width_m,
        left_middle=tuple(left),
        right_middle=tuple(right),
        torque_std=tuple(std[:3]),
        force_std=tuple(std[3:]),
        coefficients=format_rows(mean(a.matrix, b.matrix)),
        follow=format_rows(mean(a.follow_matrix, b.follow_matrix)) if a.follow and b.follow else (),
        spread=format_rows(np.vstack([np.sqrt(1.0 - s) * a.spread_matrix, np.sqrt(s) * b.spread_matrix])),
    )
