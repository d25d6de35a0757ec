# SPDX-License-Identifier: Apache-2.0
"""membrane_map.yaml: the wrench as a function of what the membranes do, for one hand at the grips identified.

The wrench on the tool about C's origin, in C, is a sum of terms, products of features (seed_core.membrane.features) in
units of their scales, times a coefficient for each of its six axes. Matrices stand as rows of numbers in a text.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from seed_core.config import ConfigError, field, load_saved, save_file
from seed_core.membrane.features import COUNT, NAMES, SCALES
from seed_core.spatial import Array
from seed_core.vector3 import Vector3

HEADER = (
    "# SPDX-License-Identifier: Apache-2.0\n"
    "# Identified map from the membranes' motion to the wrench on the tool about C, in C: torque [N m], force [N].\n"
)
PRODUCT, DIGITS = " * ", 6
VERSION = 3  # since 3 the estimator takes a band's points evenly
MOST_FACTORS = 3


@dataclass(frozen=True)
class GripMap:
    """The map at one grip."""

    pressure_hpa: float = field(unit="hPa", low=0.0, high=2000.0, doc="mean absolute pressure; 0: nobody measured it")
    width_m: float = field(unit="m", low=0.0, high=1.0, doc="gripper width")
    left_middle: Vector3 = field(unit="m", low=-0.2, high=0.2, doc="middle of the left patch at the grasp, in C")
    right_middle: Vector3 = field(unit="m", low=-0.2, high=0.2, doc="middle of the right patch at the grasp, in C")
    torque_std: Vector3 = field(unit="N m", low=0.0, high=100.0, doc="what the map leaves unexplained")
    force_std: Vector3 = field(unit="N", low=0.0, high=1000.0, doc="what the map leaves unexplained")
    coefficients: tuple[str, ...] = field(doc="torque x, y, z, force x, y, z: a number for each term [N m, N]")
    spread: tuple[str, ...] = field(doc="rows S: the coefficients' covariance is S^T S times the square of each std")
    follow: tuple[str, ...] = field(
        (), doc="rows: change of each feature, in its scale, by the tool's roll, pitch, yaw [1/rad], x, y, z [1/m] in C"
    )
    pressure_rise: tuple[str, ...] = field((), doc="two rows: common and other part, in their scale; none: no sensor")
    pressure_std: tuple[float, float] = field((0.0, 0.0), low=0.0, high=100.0, doc="what these leave unexplained")

    @cached_property
    def matrix(self) -> Array:
        """(6, terms)."""
        return parse_rows(self.coefficients, "coefficients")

    @cached_property
    def spread_matrix(self) -> Array:
        """(any, terms)."""
        return parse_rows(self.spread, "spread")

    @cached_property
    def pressure_matrix(self) -> Array:
        """(2, terms) or (0, terms)."""
        return (
            parse_rows(self.pressure_rise, "pressure_rise")
            if self.pressure_rise
            else np.zeros((0, self.matrix.shape[1]))
        )

    @cached_property
    def follow_matrix(self) -> Array:
        """(32, 6), or (0, 6) where it is not told: then the membranes go with the tool."""
        return parse_rows(self.follow, "follow") if self.follow else np.zeros((0, 6))

    @property
    def middles(self) -> Array:
        """(2, 3) [m] of the left and of the right patch."""
        return np.array([self.left_middle, self.right_middle])

    @property
    def std(self) -> Array:
        """(6,) torque [N m], force [N]."""
        return np.array([*self.torque_std, *self.force_std])


@dataclass(frozen=True)
class MembraneMapFile:
    """A whole membrane_map.yaml; grips stand in falling order of width."""

    hand: str = field(doc="name of the hand")
    tool: str = field(doc="name of the tool that was held")
    date: str = field(doc="when it was measured, ISO 8601 in quotes")
    scales: tuple[float, ...] = field(
        unit="rad, m, hPa", low=1e-9, high=10.0, doc="of the features: must be the program's"
    )
    terms: tuple[str, ...] = field(doc="products of features, such as x+ or 'x+ * y-'")
    largest: tuple[float, ...] = field(low=0.0, high=1e6, doc="of each feature among the poses identified, in scales")
    leverage: float = field(low=0.0, high=1e9, doc="largest |spread . terms|^2 among the poses identified")
    grips: tuple[GripMap, ...] = field(doc="at least one")
    motion: float = field(0.0, low=0.0, high=1e6, doc="mean squared motion of a sticking tool identified; 0: not told")
    version: int = field(VERSION, doc="of this format, and of what the estimator tells of a band")

    def __post_init__(self) -> None:
        if self.version != VERSION:
            raise ConfigError(
                f"version = {self.version} must be {VERSION}: the map is of another estimator; identify again"
            )
        if not self.grips:
            raise ConfigError("grips is empty: at least one grip is needed")
        for a, b in pairwise(self.grips):
            if not b.width_m < a.width_m:
                raise ConfigError(
                    f"grips must stand in falling order of width_m; {b.width_m:g} m follows {a.width_m:g} m"
                )
        if len(self.scales) != COUNT or not np.allclose(self.scales, SCALES, rtol=1e-6):
            raise ConfigError("scales are not those of this program's features: identify again")
        if not self.terms:
            raise ConfigError("terms is empty: at least one is needed")
        if len(self.largest) != COUNT:
            raise ConfigError(f"largest has {len(self.largest)} values; it needs {COUNT}, one for each feature")
        _ = self.products
        for i, g in enumerate(self.grips):
            if g.follow and g.follow_matrix.shape != (COUNT, 6):
                raise ConfigError(f"grips[{i}].follow is {g.follow_matrix.shape}; {COUNT} rows of 6 are needed")
            known = (g.matrix, 6), (g.spread_matrix, len(g.spread)), (g.pressure_matrix, 2 if g.pressure_rise else 0)
            for name, (matrix, height) in zip(("coefficients", "spread", "pressure_rise"), known, strict=True):
                if matrix.shape != (height, len(self.terms)):
                    raise ConfigError(
                        f"grips[{i}].{name} is {matrix.shape[0]} by {matrix.shape[1]}; "
                        f"{height} rows of {len(self.terms)}, one for each term, are needed"
                    )

    @property
    def needs_pressure(self) -> bool:
        """Whether the wrench is computed from the pressures, too."""
        return any("pressure" in term for term in self.terms)

    @cached_property
    def products(self) -> np.ndarray:
        """(terms, MOST_FACTORS) indices of each term's features; COUNT stands for the factor 1."""
        out = np.full((len(self.terms), MOST_FACTORS), COUNT)
        for row, term in zip(out, self.terms, strict=True):
            factors = term.split(PRODUCT)
            unknown = [f for f in factors if f not in NAMES]
            if unknown or len(factors) > MOST_FACTORS:
                raise ConfigError(
                    f"terms: '{term}' is no product of at most {MOST_FACTORS} features; known: {', '.join(NAMES)}"
                )
            row[: len(factors)] = [NAMES.index(f) for f in factors]
        return out


def parse_rows(texts: tuple[str, ...], name: str) -> Array:
    """The matrix (rows, columns) of rows of numbers; finite.

    Raises:
        ConfigError: no row, a word that is no finite number, or rows of different length.
    """
    if not texts:
        raise ConfigError(f"{name} has no rows; it needs at least one, of a number for each term")
    try:
        values = [[float(word) for word in text.split()] for text in texts]
    except ValueError as error:
        raise ConfigError(f"{name}: {error}") from error
    if len({len(row) for row in values}) > 1:
        raise ConfigError(f"{name}: its rows have different numbers of values: {[len(row) for row in values]}")
    out = np.array(values, dtype=float).reshape(len(texts), -1)
    if not np.isfinite(out).all():
        raise ConfigError(f"{name} has a number that is not finite")
    return out


def format_rows(matrix: Array) -> tuple[str, ...]:
    """The rows of a matrix as texts."""
    return tuple(" ".join(f"{v:.{DIGITS}g}" for v in row) for row in matrix)


def term_names(products: np.ndarray) -> tuple[str, ...]:
    """Names of terms from the indices (terms, factors) of their features."""
    return tuple(PRODUCT.join(NAMES[i] for i in row if i < COUNT) for row in products)


def load_membrane_map(path: str | Path) -> MembraneMapFile:
    """A membrane_map.yaml. Raises ConfigError with file and line."""
    return load_saved(path, MembraneMapFile, "membrane map")


def save_membrane_map(path: str | Path, file: MembraneMapFile) -> None:
    """Write a membrane_map.yaml whole or not at all."""
    save_file(path, HEADER, file, width=1_000_000)
