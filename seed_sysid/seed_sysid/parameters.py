# SPDX-License-Identifier: Apache-2.0
"""The parameters of an identification, with units and bounds."""

from dataclasses import dataclass

import numpy as np

from seed_core.bushing import MODELS, Model, Stiffness
from seed_core.config import ConfigError, field
from seed_core.hand import DEFAULT_STIFFNESS
from seed_core.spatial import Array
from seed_core.vector3 import Vector3


@dataclass(frozen=True)
class ExcitationParameters:
    """Which poses are visited around the grasp."""

    poses: int = field(60, low=12, high=1000, doc="poses at each grip, repeats of the centre included")
    translation: Vector3 = field((0.006, 0.005, 0.006), unit="m", low=1e-4, high=0.03, doc="largest along x, y, z")
    rotation_deg: Vector3 = field((12.0, 12.0, 12.0), unit="deg", low=0.1, high=30.0, doc="largest roll, pitch, yaw")
    combined: float = field(0.8, low=0.1, high=1.0, doc="share of these when several are moved at once")
    guess: Stiffness = field(DEFAULT_STIFFNESS, doc="rough stiffness, for planning within the wrench limit only")
    homes: int = field(4, low=2, high=50, doc="visits of the centre, spread over the poses: they show drift")
    seed: int = field(1, low=0, high=2**31, doc="of the search for combined poses")
    work_force: Vector3 = field(
        (0.0, 0.0, 0.0),
        unit="N",
        low=0.0,
        high=200.0,
        doc="largest force of the tool on its work, at work_tip: along x and y of T whatever friction drags, along z "
        "the press; twelve poses load the grasp so in place of combinations. 0 0 0: none",
    )
    work_tip: Vector3 = field((0.0, 0.0, 0.12), unit="m", low=-1.0, high=1.0, doc="where the tool works, in T")

    @property
    def amplitudes(self) -> Array:
        """(6,) largest excursion of each axis [rad, m]."""
        return np.concatenate([np.deg2rad(self.rotation_deg), self.translation])


@dataclass(frozen=True)
class LimitParameters:
    """What no pose may exceed, watched at every reading; where the values come from: docs/identification.md."""

    force: float = field(15.0, unit="N", low=0.1, high=500.0, doc="largest force after taking off the sensor's bias")
    torque: float = field(1.5, unit="N m", low=0.01, high=50.0, doc="largest torque after taking off the bias")
    translation: float = field(0.012, unit="m", low=1e-3, high=0.05, doc="largest deflection of the grasp")
    rotation_deg: float = field(25.0, unit="deg", low=1.0, high=45.0, doc="largest turn; the tool slips near 30")
    slip: float = field(0.3, low=0.0, high=1.0, doc="largest share of the motion that the membrane does not follow")
    lost: float = field(0.4, unit="s", low=0.05, high=60.0, doc="longest that an estimator may not follow the tool")
    search: float = field(3.0, unit="s", low=0.1, high=60.0, doc="given to it at the centre to find the tool again")
    planned_share: float = field(0.6, low=0.1, high=1.0, doc="share of force and torque limit used when planning")


@dataclass(frozen=True)
class SettleParameters:
    """When a pose counts as at rest, and how long it is then measured."""

    window: float = field(0.8, unit="s", low=0.1, high=10.0, doc="its two halves are compared")
    hold: float = field(0.8, unit="s", low=0.0, high=30.0, doc="rest has to last this long before it is measured")
    force: float = field(0.03, unit="N", low=1e-4, high=10.0, doc="change between halves that is still rest")
    torque: float = field(0.001, unit="N m", low=1e-5, high=1.0, doc="change between halves that is still rest")
    average: float = field(0.6, unit="s", low=0.05, high=30.0, doc="readings over this time make one sample")
    timeout: float = field(
        6.0, unit="s", low=0.2, high=60.0, doc="then the pose is measured all the same, and marked; >= window + hold"
    )

    def __post_init__(self) -> None:
        least = self.window + self.hold
        if self.timeout < least - 1e-9:
            raise ConfigError(
                f"settle.timeout = {self.timeout:g} s must be at least settle.window + settle.hold = {least:g} s: "
                "no pose could come to rest before"
            )


@dataclass(frozen=True)
class MotionParameters:
    """How the arm goes from pose to pose."""

    speed: float = field(0.01, unit="m/s", low=1e-4, high=0.1, doc="largest speed")
    turn_rate_deg: float = field(20.0, unit="deg/s", low=0.1, high=60.0, doc="largest rate of turning")
    grip_time: float = field(3.0, unit="s", low=0.0, high=60.0, doc="rest after the gripper's width has changed")


@dataclass(frozen=True)
class FitParameters:
    """How the data are fitted."""

    model: Model = field("midpoint", choices=MODELS, doc="the stiffness map: midpoint, or plain (the paper's)")
    confidence: float = field(0.95, low=0.5, high=0.999, doc="of the intervals")
    outlier: float = field(1e-5, low=1e-12, high=0.05, doc="a sample less likely than this is an outlier")
    offset: bool = field(True, doc="also find the pose of the sensor's frame relative to the tool's")
    drift: bool = field(True, doc="also find a steady drift of the sensor's bias")
    hysteresis: bool = field(True, doc="also find friction on axes whose loading and unloading differ")


@dataclass(frozen=True)
class Procedure:
    """One identification, on hardware or simulated."""

    widths: list[float] = field([0.026, 0.020, 0.014], unit="m", low=0.0, high=0.2, doc="gripper widths to visit")
    excitation: ExcitationParameters = field(ExcitationParameters())
    limits: LimitParameters = field(LimitParameters())
    settle: SettleParameters = field(SettleParameters())
    motion: MotionParameters = field(MotionParameters())
    fit: FitParameters = field(FitParameters())

    def __post_init__(self) -> None:
        if not self.widths:
            raise ConfigError("widths is empty: at least one width of the gripper is needed")
