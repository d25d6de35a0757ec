# SPDX-License-Identifier: Apache-2.0
"""hysteretic_spring.yaml: an identified spring that stiffens and has hysteresis, of one hand with one tool."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seed_core.bushing import COORDINATES
from seed_core.config import ConfigError, field, load_saved, save_file
from seed_core.hysteretic.spring import HystereticStiffness
from seed_core.vector3 import Vector3

HEADER = (
    "# SPDX-License-Identifier: Apache-2.0\n"
    "# Identified spring: load k xi + rise xi |xi| + friction z along roll, pitch, yaw [rad], x, y, z [m].\n"
)
_LARGE = 1e12


@dataclass(frozen=True)
class SpringAxis:
    """The spring along one coordinate; units are N m and rad, or N and m."""

    axis: str = field(choices=COORDINATES, doc="which coordinate")
    stiffness: float = field(unit="N m/rad or N/m", low=1e-6, high=1e9, doc="at rest, without friction")
    rise: float = field(unit="N m/rad^2 or N/m^2", low=-_LARGE, high=_LARGE, doc="of the stiffness with deflection")
    yields: tuple[float, ...] = field(unit="rad or m", low=1e-12, high=10.0, doc="of each friction element")
    friction: tuple[float, ...] = field(unit="N m or N", low=0.0, high=1e6, doc="that each element bears")
    covariance: tuple[float, ...] = field(low=-_LARGE, high=_LARGE, doc="of stiffness, rise, friction; row by row")
    residual: float = field(unit="N m or N", low=0.0, high=1e6, doc="standard deviation of what is left")
    largest: float = field(unit="rad or m", low=1e-9, high=10.0, doc="deflection that was identified")

    def __post_init__(self) -> None:
        n = len(self.yields)
        if len(self.friction) != n or len(self.covariance) != (2 + n) ** 2:
            raise ConfigError(
                f"axis {self.axis}: {n} yields need {n} values of friction and {(2 + n) ** 2} of covariance; there are "
                f"{len(self.friction)} and {len(self.covariance)}"
            )


@dataclass(frozen=True)
class HystereticFile:
    """A whole hysteretic_spring.yaml."""

    hand: str = field(doc="name of the hand")
    tool: str = field(doc="name of the tool that was held")
    date: str = field(doc="when it was measured, ISO 8601 in quotes")
    pressure_hpa: float = field(unit="hPa", low=0.0, high=2000.0, doc="mean absolute pressure of both bubbles")
    width_m: float = field(unit="m", low=0.0, high=1.0, doc="gripper width")
    centre: Vector3 = field(unit="m", low=-0.2, high=0.2, doc="elastic centre in T at the grasp")
    axes: tuple[SpringAxis, ...] = field(doc="roll, pitch, yaw, x, y, z")
    version: int = field(1, low=1, high=1, doc="of this format")

    def __post_init__(self) -> None:
        if tuple(a.axis for a in self.axes) != COORDINATES:
            raise ConfigError(f"axes must be {', '.join(COORDINATES)} in this order, not {[a.axis for a in self.axes]}")
        if len({len(a.yields) for a in self.axes}) > 1:
            raise ConfigError("all axes must have as many friction elements")

    @property
    def identified(self) -> HystereticStiffness:
        """The spring."""
        n = 2 + len(self.axes[0].yields)
        return HystereticStiffness(
            stiffness=np.array([a.stiffness for a in self.axes]),
            rise=np.array([a.rise for a in self.axes]),
            yields=np.array([a.yields for a in self.axes]).T,
            friction=np.array([a.friction for a in self.axes]).T,
            covariance=np.array([a.covariance for a in self.axes]).reshape(6, n, n),
            residual=np.array([a.residual for a in self.axes]),
            largest=np.array([a.largest for a in self.axes]),
            centre=np.array(self.centre),
        )


def hysteretic_file(
    spring: HystereticStiffness, hand: str, tool: str, date: str, pressure_hpa: float, width_m: float
) -> HystereticFile:
    """The file of a spring that was identified at that pressure [hPa] and width [m]."""
    x, y, z = spring.centre.tolist()
    axes = tuple(
        SpringAxis(
            axis=axis,
            stiffness=float(spring.stiffness[i]),
            rise=float(spring.rise[i]),
            yields=tuple(spring.yields[:, i].tolist()),
            friction=tuple(spring.friction[:, i].tolist()),
            covariance=tuple(spring.covariance[i].ravel().tolist()),
            residual=float(spring.residual[i]),
            largest=float(spring.largest[i]),
        )
        for i, axis in enumerate(COORDINATES)
    )
    return HystereticFile(hand, tool, date, pressure_hpa, width_m, (x, y, z), axes)


def load_hysteretic(path: str | Path) -> HystereticFile:
    """A hysteretic_spring.yaml. Raises ConfigError with file and line."""
    return load_saved(path, HystereticFile, "file of a hysteretic spring")


def save_hysteretic(path: str | Path, file: HystereticFile) -> None:
    """Write a hysteretic_spring.yaml whole or not at all."""
    save_file(path, HEADER, file)
