# SPDX-License-Identifier: Apache-2.0
"""A grasp whose spring stiffens and has hysteresis: a `WrenchModel` of the tool's pose with a memory of its way.

Along each generalised coordinate xi of the stiffness map (Theorem 1: rpy, and the translation half rotated) the load is

    k xi + r xi |xi| + sum_i h_i z_i

with elastic-then-sliding elements (Prandtl): z_i in [-1, 1] follows d xi / y_i. All of it acts about an elastic centre,
a point of T that lay at the same place of C at the grasp. With that at the origin and r = h = 0 it is `Bushing`, model
midpoint. `./seed identify` finds k, r and h by least squares, see seed_sysid.fit.hysteretic_fit.
"""

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from seed_core.bushing import COORDINATES, Bushing, Stiffness
from seed_core.config import ConfigError
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, rpy_from_rotation, skew, so3_exp, so3_log
from seed_core.wrench_model import BushingModel, MapUncertainty, SpringWrench, observed_part, pose_covariance

BEYOND = 1.5  # times what was identified, on any coordinate, is outside
_SURE = MapUncertainty(residual=0.0, coupling=0.0, lever=0.0, unidentified=0.0, drift=0.0)


@dataclass(frozen=True)
class HystereticStiffness:
    """What is identified of one grasp, by coordinate: roll, pitch, yaw [rad], x, y, z [m].

    Attributes:
        stiffness: (6,) k [N m/rad, N/m], at rest and without friction. rise: (6,) r [N m/rad^2, N/m^2].
        yields: (n, 6) y [rad, m] of the elements. friction: (n, 6) h [N m, N].
        covariance: (6, 2 + n, 2 + n) of (k, r, h) by coordinate.
        residual: (6,) standard deviation of what the model leaves of torque [N m] and force [N].
        largest: (6,) of each coordinate among the poses identified [rad, m].
        centre: (3,) elastic centre in T at the grasp [m].

    Raises:
        ConfigError: shapes do not fit, or a value is out of its bounds.
    """

    stiffness: Array
    rise: Array
    yields: Array
    friction: Array
    covariance: Array
    residual: Array
    largest: Array
    centre: Array

    def __post_init__(self) -> None:
        n = len(self.yields)
        shapes = {"stiffness": (6,), "rise": (6,), "yields": (n, 6), "friction": (n, 6)}
        shapes |= {"covariance": (6, 2 + n, 2 + n), "residual": (6,), "largest": (6,), "centre": (3,)}
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value.shape != shape or not np.isfinite(value).all():
                raise ConfigError(f"hysteretic spring: {name} must be {shape} finite numbers, not {value.shape}")
        for name in ("stiffness", "yields"):
            if not (getattr(self, name) > 0.0).all():
                raise ConfigError(
                    f"hysteretic spring: {name} = {np.round(getattr(self, name), 4).tolist()} must be > 0"
                )
        if not (self.friction >= 0.0).all():
            raise ConfigError(f"hysteretic spring: friction = {np.round(self.friction, 4).tolist()} must be >= 0")

    def mean_stiffness(self) -> Stiffness:
        """That of a straight line through the loads up to what was identified, friction fully grown at its end."""
        grown = self.friction.sum(axis=0) / np.maximum(self.largest, 1e-9)
        return Stiffness.from_vector(
            np.maximum(self.stiffness + self.rise * self.largest + grown, 0.2 * self.stiffness)
        )


class HystereticSpring:
    """The model of one grasp, which remembers where it has been: tell it every estimate from the grasp on.

    Attributes:
        name: 'hysteretic'. stiffness: at rest, of a mean line; the load itself is not on it.
    """

    name = "hysteretic"

    def __init__(self, identified: HystereticStiffness) -> None:
        self.identified = identified
        self._mean = identified.mean_stiffness()
        self._tangent = BushingModel(Bushing(self._mean), _SURE, np.zeros(6))
        self.reset()

    def reset(self) -> None:
        """The tool is grasped anew."""
        self._z = np.zeros_like(self.identified.yields)
        self._xi = np.zeros(6)
        self._before = self._z, self._xi

    def take_back(self) -> None:
        """The newest estimate was none: as if `spring` had not been told of it."""
        self._z, self._xi = self._before

    @property
    def stiffness(self) -> Stiffness:
        """Of a mean line; the same everywhere."""
        return self._mean

    def spring(self, estimate: RelativePoseEstimate) -> SpringWrench:
        """The load at the estimate's pose, having come from the last one's straight along each coordinate."""
        s = self.identified
        estimate = estimate.of_patches()
        X_TC = inverse_pose(observed_part(estimate))
        R = X_TC[:3, :3]
        about_centre = make_pose(R, about(s.centre, R, X_TC[:3, 3]))
        B, xi = coordinates(R, about_centre[:3, 3])
        self._before = self._z, self._xi
        self._z = np.clip(self._z + (xi - self._xi) / s.yields, -1.0, 1.0)
        self._xi = xi
        wrench = B @ self.load(xi, self._z)
        moved = np.eye(6)  # a turn of the tool shifts the centre
        moved[3:, :3] = -skew(R.T @ s.centre)
        of_pose = moved @ pose_covariance(estimate) @ moved.T
        by_pose, _ = self._tangent.covariances(about_centre, Wrench.from_vector(wrench), of_pose)
        to_T = np.eye(6)
        to_T[:3, 3:] = skew(s.centre)
        wrench, B, C = to_T @ wrench, to_T @ B, to_T @ by_pose @ to_T.T
        terms = np.vstack([xi, xi * np.abs(xi), self._z]).T  # (6, 2 + n)
        along = np.einsum("ji,jik,jk->j", terms, s.covariance, terms)
        C = C + (B * along) @ B.T
        C[np.diag_indices(6)] += s.residual**2
        return SpringWrench(Wrench.from_vector(wrench), C, self._beyond(xi))

    def load(self, xi: Array, z: Array) -> Array:
        """(6,) along the coordinates xi (6,), with the elements at z (n, 6)."""
        s = self.identified
        return np.asarray(s.stiffness * xi + s.rise * xi * np.abs(xi) + (s.friction * z).sum(axis=0))

    def _beyond(self, xi: Array) -> str:
        over = np.abs(xi) / self.identified.largest
        i = int(np.argmax(over))
        if over[i] <= BEYOND:
            return ""
        turn = i < 3
        value, most = (
            np.rad2deg(v) if turn else 1e3 * v for v in (float(abs(xi[i])), float(self.identified.largest[i]))
        )
        unit = "deg" if turn else "mm"
        return (
            f"beyond the range of the identification: {COORDINATES[i]} is {value:.1f} {unit}, identified up to "
            f"{most:.1f} {unit}: press less, or identify with larger poses"
        )


def about(centre: Array, R: Array, p: Array) -> Array:
    """p (3,) of the elastic centre in C from that in T, of a pose R_TC (3, 3), p_TC (3,) [m]."""
    return np.asarray(p + R @ centre - centre)


def coordinates(R: Array, p: Array) -> tuple[Array, Array]:
    """B (6, 6) and xi (6,) of the midpoint stiffness map at R_TC (3, 3), p_TC (3,) [m]: the wrench is B times the load.

    As seed_sysid.stiffness_map, for one pose at a tenth of its cost.
    """
    q = rpy_from_rotation(R)
    pitch, yaw = float(q[1]), float(q[2])
    c1, s1, c2, s2 = cos(pitch), sin(pitch), cos(yaw), sin(yaw)
    R_TB = so3_exp(0.5 * so3_log(R))
    B = np.zeros((6, 6))
    B[:3, :3] = ((c2 / c1, -s2, c2 * s1 / c1), (s2 / c1, c2, s2 * s1 / c1), (0.0, 0.0, 1.0))
    B[3:, 3:] = R_TB
    B[:3, 3:] = 0.5 * skew(p) @ R_TB
    return B, np.concatenate([q, R_TB.T @ p])
