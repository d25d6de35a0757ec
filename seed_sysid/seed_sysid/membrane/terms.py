# SPDX-License-Identifier: Apache-2.0
"""The terms of the membrane map, products of features, in groups whose strengths the data decide.

A grasp that is its own image in a mirror lets a component of the wrench depend on such products alone as change their
sign in the mirror as it does. Fingers face each other across the plane y = 0 of C; products that this mirror forbids
belong to fingers that differ, and linear ones of them are offered. Membranes and handles are often symmetric about
x = 0 and z = 0 as well: what these mirrors forbid stands in groups of its own, which the data make as strong as they
need. Without them, where the elastic centre lies and where the sensor's frame is could not be told apart.
"""

from collections.abc import Iterable
from itertools import combinations_with_replacement, product
from typing import NamedTuple

import numpy as np

from seed_core.membrane.features import COUNT, PER_FINGER, STICKING, WRENCH_MIRROR
from seed_core.membrane.map_file import MOST_FACTORS
from seed_core.spatial import Array

Product = tuple[int, ...]
_OF_FINGER_X = (1, -1, -1, -1, 1, 1, 1, 1, -1, -1, 1, -1, 1, -1, 1, 1)  # sign of each in the mirror x = 0
_OF_FINGER_Z = (-1, -1, 1, 1, 1, -1, 1, 1, -1, 1, -1, 1, -1, 1, -1, 1)  # and z = 0; that of y = 0 swaps the fingers
PARITY = np.where(np.arange(COUNT) < PER_FINGER, 1.0, -1.0)  # of features in the mirror y = 0
PARITY_XZ = np.tile(np.array([_OF_FINGER_X, _OF_FINGER_Z], dtype=float), 2)  # (2, COUNT)
PRESSURES = tuple(i for i in range(COUNT) if i % PER_FINGER == PER_FINGER - 1)
RIGID = tuple(i for i in range(COUNT) if i % PER_FINGER < 6)
MAIN = tuple(STICKING)  # what a sticking tool moves
APART = tuple(i for i in RIGID if i not in MAIN)
DEFORMING = tuple(i for i in range(COUNT) if i not in RIGID and i not in PRESSURES)
WRENCH_PARITY = np.array([WRENCH_MIRROR, (1, -1, -1, -1, 1, 1), (-1, -1, 1, 1, 1, -1)], dtype=float).T  # (6, 3)
GAS_PARITY = np.array(((1.0, 1.0, 1.0), (-1.0, 1.0, 1.0)))  # of the rise of pressure in common and apart

KINDS: dict[str, tuple[Product, ...]] = {
    "motion of the tool": tuple((i,) for i in MAIN),
    "fingers apart": tuple((i,) for i in APART),
    "deformation": tuple((i,) for i in DEFORMING),
    "pressure": tuple((i,) for i in PRESSURES),
    "squares": tuple(combinations_with_replacement(MAIN, 2)),
    "squares apart": (*product(MAIN, APART), *combinations_with_replacement(APART, 2)),
    "cubes": tuple(combinations_with_replacement(MAIN, 3)),
    "motion under pressure": tuple(product(RIGID, PRESSURES)),
}
MODELS: dict[str, tuple[str, ...]] = {
    "rigid, together": ("motion of the tool",),
    "rigid, per finger": ("motion of the tool", "fingers apart"),
    "with deformation": ("motion of the tool", "fingers apart", "deformation"),
    "smooth": ("motion of the tool", "fingers apart", "deformation", "squares", "squares apart", "cubes"),
    "smooth, with pressure": tuple(KINDS),
}
DEFAULT_MODEL = "smooth"


class Group(NamedTuple):
    """Terms that share one strength; those of mirrored fingers, and others."""

    name: str
    terms: tuple[Product, ...]
    mirrored: bool


def groups(kinds: Iterable[str], parity: Array, skewed: bool = True) -> list[Group]:
    """The groups of a component whose signs in the mirrors y = 0, x = 0, z = 0 are parity (3,).

    skewed: whether those that x = 0 or z = 0 forbid are among them.
    """
    symmetric, lopsided, forbidden = [], [], []
    products = list[Product]()
    for kind in kinds:
        allowed = [t for t in KINDS[kind] if PARITY[list(t)].prod() == parity[0]]
        whole = [t for t in allowed if (PARITY_XZ[:, list(t)].prod(axis=1) == parity[1:]).all()]
        rest = [t for t in allowed if t not in whole]
        symmetric.append(Group(kind, tuple(whole), True))
        if len(KINDS[kind][0]) == 1:
            lopsided.append(Group(f"{kind}, skewed", tuple(rest), True))
            forbidden += [t for t in KINDS[kind] if t not in allowed]
        else:
            products += rest
    lopsided.append(Group("products, skewed", tuple(products), True))
    offered = (*symmetric, *(lopsided if skewed else ()), Group("fingers that differ", tuple(forbidden), False))
    return [g for g in offered if g.terms]


def indices(terms: Iterable[Product]) -> np.ndarray:
    """(terms, MOST_FACTORS) indices of the factors, COUNT for 1, as a map holds them."""
    return np.array([list(t) + [COUNT] * (MOST_FACTORS - len(t)) for t in terms]).reshape(-1, MOST_FACTORS)


def values(Z: Array, terms: Iterable[Product]) -> Array:
    """(n, terms) of features Z (n, COUNT)."""
    padded = np.hstack([Z, np.ones((len(Z), 1))])
    return np.asarray(padded[:, indices(terms)].prod(axis=2))
