# SPDX-License-Identifier: Apache-2.0
"""The fit of the membrane map: wrench in C = terms of the membranes' motion + what the sensor adds.

    w_C = sum_k (c_k + g d_k) t_k(z) + Ad(X_CT) (bias_grip + drift s + offset of the sensor's frame)

g runs from -1 to 1 over the grips' widths. Component by component, the strengths of the groups of terms are those that
make the data most probable (seed_sysid.membrane.regression); the sensor's part is common to all components and found in
turn. The larger a motion the worse any smooth function fits, so samples weigh less with the square of their motion.

An offset of the sensor's frame and an elastic centre beside the patches give nearly the same wrenches while the tool
turns little. So a grasp is symmetric about its patches at first, which leaves the lever to the sensor; only then the
terms that the mirrors x = 0 and z = 0 forbid may take what the data show of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seed_core.spatial import Array
from seed_sysid.data.dataset import DatasetError
from seed_sysid.fit.checks import MOST_OUTLIERS
from seed_sysid.fit.stiffness_schedule import NORMAL_95
from seed_sysid.membrane.data import MembraneData
from seed_sysid.membrane.regression import Regression, regress
from seed_sysid.membrane.terms import GAS_PARITY, KINDS, MAIN, MODELS, PRESSURES, WRENCH_PARITY, Group, groups, values

_ROUNDS = 3
_STILL = 0.1  # share of the median squared motion at which weights begin to fall
_FEW_OUTLIERS = 0.1  # share; more hide each other
_OUTLIER = 100.0  # sum of six squared errors in robust deviations: 12 is the 95 % quantile of normal ones
_RANK = 24  # rows kept of the coefficients' spread


@dataclass(frozen=True)
class Component:
    """One fitted component: its groups of terms, at all grips and, if there are several, with the grip."""

    groups: list[Group]
    F: list[Array]
    regression: Regression
    left_out: Array  # (n,) error of each sample predicted from all others
    unseen: Array  # (n,) the same from those of other paths

    def coefficients(self, g: float) -> dict[tuple[int, ...], float]:
        """Of each term at grip g in [-1, 1]."""
        out: dict[tuple[int, ...], float] = {}
        for group, c in zip(self.groups, self.regression.coefficients, strict=False):
            out.update(zip(group.terms, c.tolist(), strict=True))
        by_grip = self.regression.coefficients[len(self.groups) :]
        for terms, c in zip(_by_grip(self.groups), by_grip, strict=False):
            for term, value in zip(terms, c.tolist(), strict=True):
                out[term] += g * value
        return out

    def half_widths(self) -> dict[tuple[int, ...], float]:
        """Of each term's 95 % interval, at the middle grip."""
        covariance = self.regression.covariance(self.F)
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
        return dict(zip((t for g in self.groups for t in g.terms), (NORMAL_95 * v for v in std), strict=False))


@dataclass(frozen=True)
class MembraneFit:
    """The map found.

    Attributes:
        model: of MODELS. components: torque x, y, z, force x, y, z; gas: rise of pressure in common and apart, or ().
        nuisance: (k,) bias of each grip, drift and offset, as `MembraneData.nuisance` counts them.
        left_out: (n, 6) [N m, N] error of each sample predicted from all others.
        unseen: (n, 6) [N m, N] error of each sample predicted from those of other paths: a sample's neighbours on its
            own way, there and back and at other grips, flatter the map.
        wrench: (n, 6) [N m, N] without the sensor's part. All these are about the point midway between the patches.
    """

    data: MembraneData
    model: str
    components: tuple[Component, ...]
    gas: tuple[Component, ...]
    nuisance: Array
    left_out: Array
    unseen: Array
    wrench: Array

    @property
    def share(self) -> Array:
        """(6,) rms of `left_out` over that of the wrench: what the map leaves unexplained."""
        return rms(self.left_out) / np.maximum(rms(self.wrench), 1e-12)

    @property
    def terms(self) -> list[tuple[int, ...]]:
        """All terms of the model."""
        return [t for kind in MODELS[self.model] for t in KINDS[kind]]

    def coefficients(self, g: float) -> tuple[Array, Array]:
        """(6, terms) of the wrench and (2 or 0, terms) of the pressures at grip g in [-1, 1]."""
        place = {t: i for i, t in enumerate(self.terms)}
        out = np.zeros((len(self.components) + len(self.gas), len(place)))
        for row, component in zip(out, (*self.components, *self.gas), strict=True):
            for term, value in component.coefficients(g).items():
                row[place[term]] = value
        return out[:6], out[6:]

    def follow(self) -> Array:
        """(32, 6) change of each feature with the tool's motion in C, over all poses; small ones count more."""
        weight = sample_weights(self.data.Z)[:, None]
        return np.asarray(np.linalg.lstsq(self.data.motion * weight, self.data.Z * weight, rcond=None)[0].T)

    def spread(self) -> Array:
        """(rows, terms) S: the coefficients' covariance is about S^T S times each component's variance."""
        place = {t: i for i, t in enumerate(self.terms)}
        total, count = np.zeros((len(place), len(place))), np.zeros((len(place), len(place)))
        for component in self.components:
            own = [g for g in component.groups if g.mirrored]
            ids = np.array([place[t] for g in own for t in g.terms])
            covariance = component.regression.covariance(component.F)[: len(ids), : len(ids)]
            total[np.ix_(ids, ids)] += covariance / component.regression.noise
            count[np.ix_(ids, ids)] += 1.0
        covariance = total / np.maximum(count, 1.0)
        size = np.maximum(rms(values(self.data.Z, self.terms)), 1e-9)  # of the terms: what matters for predictions
        power, vectors = np.linalg.eigh(size[:, None] * covariance * size)
        return np.asarray((np.sqrt(np.maximum(power[-_RANK:], 0.0)) * vectors[:, -_RANK:] / size[:, None]).T)


def fit_membrane(data: MembraneData, model: str, known: Array | None = None) -> MembraneFit:
    """Fit a model of MODELS to the data of an identification; known: (k,) the sensor's part from another fit."""
    path, grips = data.path, len(data.widths)
    weight, g = sample_weights(data.Z), grip_coordinate(data.widths)[data.grip]
    measured = data.wrench
    nuisance = np.zeros(data.nuisance.shape[2]) if known is None else known
    parts: list[Component] = []
    for skewed in (False, True) if known is None else (True,):
        starts: list[Array | None] = [None] * 6
        for _ in range(_ROUNDS if known is None else 1):
            wrench = measured - data.nuisance @ nuisance
            parts = []
            for i, parity in enumerate(WRENCH_PARITY):
                offered = groups(MODELS[model], parity, skewed)
                parts.append(_component(data.Z, wrench[:, i], weight, g, offered, starts[i], grips, path))
                starts[i] = _logarithms(parts[i].regression, wrench[:, i] * weight)
            nuisance = _nuisance(data, parts, weight) if known is None else known
    wrench = measured - data.nuisance @ nuisance
    gas: tuple[Component, ...] = ()
    if data.with_pressure and known is None:
        motion = [kind for kind in MODELS[model] if "pressure" not in kind]
        gas = tuple(
            _component(data.Z, data.Z[:, i], weight, g, groups(motion, parity), None, grips, path)
            for i, parity in zip(PRESSURES, GAS_PARITY, strict=True)
        )
    left_out, unseen = np.array([p.left_out for p in parts]).T, np.array([p.unseen for p in parts]).T
    return MembraneFit(data, model, tuple(parts), gas, nuisance, left_out, unseen, wrench)


def fit_without_outliers(data: MembraneData, model: str) -> tuple[MembraneFit, int]:
    """The fit, and how many samples were left out because the others do not predict them at all.

    Many gross errors hide each other and make good samples look wrong, so of many only the worse half is left out
    before the others are judged anew.

    Raises:
        DatasetError: so many of a grip are not predicted that nobody knows which are right.
    """
    fit, grip = fit_membrane(data, model), data.grip
    poses = np.bincount(grip)
    while True:
        squared = _squared_errors(fit)
        bad = int((squared > _OUTLIER).sum())
        if not bad:
            return fit, len(grip) - len(squared)
        worst = np.argsort(-squared)[: bad if bad <= _FEW_OUTLIERS * len(squared) else (bad + 1) // 2]
        kept = fit.data.without(np.isin(np.arange(len(squared)), worst))
        gone = poses - np.bincount(kept.grip, minlength=len(poses))
        if (gone > MOST_OUTLIERS * poses).any():
            g = int(np.argmax(gone / poses))
            raise DatasetError(
                f"{gone[g]} of {poses[g]} samples of a grip {1e3 * data.widths[g]:.1f} mm wide are not predicted by "
                f"the others (at most {MOST_OUTLIERS:.0%} may be left out): check that the estimator follows the tool "
                "and that nothing but the hand touches the sensor, and record again"
            )
        fit = fit_membrane(kept, model)


def _squared_errors(fit: MembraneFit) -> Array:
    """(n,) of each sample, predicted from all others: sum over six components in robust deviations."""
    weighed = fit.left_out * sample_weights(fit.data.Z)[:, None]
    return np.asarray(((weighed / (1.4826 * np.median(np.abs(weighed), axis=0))) ** 2).sum(axis=1))


def sample_weights(Z: Array) -> Array:
    """(n,) of samples, mean 1: constant for small motions of the tool, then falling with their size."""
    motion = (Z[:, list(MAIN)] ** 2).sum(axis=1)
    weight = 1.0 / np.sqrt(_STILL + motion / np.median(motion))
    return np.asarray(weight / weight.mean())


def grip_coordinate(widths: Array) -> Array:
    """(G,) in [-1, 1] of grips by their width."""
    span = float(np.ptp(widths))
    return np.asarray(2.0 * (widths - widths.min()) / span - 1.0) if span > 0.0 else np.zeros(len(widths))


def rms(values: Array) -> Array:
    """Root mean square over samples."""
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def _by_grip(parts: list[Group]) -> list[tuple[tuple[int, ...], ...]]:
    """Terms that change with the grip: linear ones, then products."""
    plain = [p for p in parts if p.mirrored and "skewed" not in p.name]
    linear = tuple(t for p in plain for t in p.terms if len(t) == 1)
    products = tuple(t for p in plain for t in p.terms if len(t) > 1)
    return [terms for terms in (linear, products) if terms]


def _component(
    Z: Array,
    y: Array,
    weight: Array,
    g: Array,
    parts: list[Group],
    start: Array | None,
    grips: int,
    path: np.ndarray,
) -> Component:
    F = [values(Z, p.terms) for p in parts]
    if grips > 1:
        F += [g[:, None] * values(Z, terms) for terms in _by_grip(parts)]
    F = [f * weight[:, None] for f in F]
    found = regress(F, y * weight, start)
    return Component(parts, F, found, found.left_out / weight, found.left_out_together(path) / weight)


def _logarithms(found: Regression, y: Array) -> Array:
    return np.asarray(np.log(np.append(found.strengths, found.noise) / np.mean(y**2)))


def _nuisance(data: MembraneData, parts: list[Component], weight: Array) -> Array:
    """The sensor's part by generalised least squares, the terms' uncertainty in the covariance of the wrenches."""
    A, b = np.diag(data.nuisance_std**-2.0), np.zeros(len(data.nuisance_std))
    for i, part in enumerate(parts):
        H = weight[:, None] * data.nuisance[:, i]
        A += H.T @ part.regression.inverse @ H
        b += H.T @ part.regression.inverse @ (weight * data.wrench[:, i])
    return np.asarray(np.linalg.solve(A, b))
