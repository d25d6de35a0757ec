# SPDX-License-Identifier: Apache-2.0
"""What one world is and the suite is not told. Every default is a world that is exactly as believed.

docs/worlds.md tells where each range of the draw comes from, docs/tactile_simulation.md what bubbles do.
"""

from dataclasses import dataclass
from typing import Literal

from seed_core.config import field
from seed_core.vector3 import ZERO, Vector3

Vector6 = tuple[float, float, float, float, float, float]
Kind = Literal["spring", "membrane"]
KINDS: tuple[Kind, ...] = ("spring", "membrane")


@dataclass(frozen=True)
class SpringWorld:
    """How the spring differs from the linear one of the scenario; full scale: `full_translation`, `full_turn_deg`."""

    scale: Vector6 = field((1.0,) * 6, low=0.1, high=10.0, doc="of roll, pitch, yaw, x, y, z of the stiffness")
    stiffening: float = field(0.0, low=0.0, high=2.0, doc="rise of load over deflection at full scale")
    hysteresis: float = field(0.0, low=0.0, high=1.0, doc="friction either way, as a share of the load at full scale")
    centre_mm: Vector3 = field(ZERO, unit="mm", low=-50.0, high=50.0, doc="the spring's middle in T at the grasp")
    relaxation: float = field(0.0, low=0.0, high=0.9, doc="share of the load that decays while a deflection is held")
    relaxation_time: float = field(2.0, unit="s", low=0.01, high=100.0, doc="in which it decays by e")
    fade: float = field(0.0, low=-0.9, high=0.9, doc="share of the stiffness that is lost in the task, as pressure is")
    fade_time: float = field(6.0, unit="s", low=0.01, high=1000.0, doc="in which it is lost, evenly from the start on")
    full_translation: float = field(0.012, unit="m", low=1e-3, high=0.1, doc="full scale of x, y, z")
    full_turn_deg: float = field(20.0, unit="deg", low=1.0, high=90.0, doc="full scale of roll, pitch, yaw")


@dataclass(frozen=True)
class CameraWorld:
    """How one finger's camera and membrane differ from hand, calibration and reference."""

    turn_deg: Vector3 = field(ZERO, unit="deg", low=-10.0, high=10.0, doc="of the mount, about x, y, z of C")
    shift_mm: Vector3 = field(ZERO, unit="mm", low=-20.0, high=20.0, doc="of the mount, along x, y, z of C")
    focal: float = field(0.0, low=-0.2, high=0.2, doc="relative error of the focal length")
    depth_scale: float = field(0.0, low=-0.2, high=0.2, doc="relative error of depth")
    shape_mm: float = field(0.0, unit="mm", low=-5.0, high=5.0, doc="rise of the dome's apex after the reference")
    range_mm: float = field(0.0, unit="mm", low=-10.0, high=10.0, doc="change of the range after the reference")


@dataclass(frozen=True)
class ImageWorld:
    """Both fingers' cameras, and when their images are taken."""

    left: CameraWorld = field(CameraWorld())
    right: CameraWorld = field(CameraWorld())
    depth_lag: float = field(0.0, unit="s", low=0.0, high=0.5, doc="time constant of the depth's filter in time")
    clock: float = field(0.0, unit="s", low=-0.25, high=0.25, doc="by which stamps are ahead of the robot's clock")
    skew: float = field(0.0, unit="s", low=0.0, high=0.1, doc="by which the right finger's image is taken earlier")
    skew_stamped: bool = field(False, doc="each finger's stamp tells its own time; else the pair shares one stamp")
    slip: float = field(0.0, low=0.0, high=0.9, doc="share of the tool's motion that the membrane does not follow")
    creep_hold_mm: float = field(
        0.0,
        unit="mm",
        low=0.0,
        high=50.0,
        doc="sideways way at which the tool would slide; the patch's edge does before",
    )
    range_error: float = field(0.0, low=0.0, high=3.0, doc="scale of the smooth range error; 1: as cameras come")
    zero_mm: Vector3 = field(ZERO, unit="mm", low=-5.0, high=5.0, doc="by which the pose that is told is off, in T")


@dataclass(frozen=True)
class CellWorld:
    """Arm, tool and table."""

    flange_turn_deg: Vector3 = field(ZERO, unit="deg", low=-5.0, high=5.0, doc="of C in the flange, about its axes")
    flange_shift_mm: Vector3 = field(ZERO, unit="mm", low=-20.0, high=20.0, doc="of C in the flange")
    mass: float = field(0.0, low=-0.9, high=5.0, doc="relative error of the tool's mass as it is stated")
    tilt_deg: float | None = field(None, unit="deg", low=0.0, high=30.0, doc="largest tilt of the table; scenario's")
    friction: float | None = field(None, low=0.0, high=2.0, doc="of the table; default: the scenario's")
    hanging: bool = field(False, doc="the grasp is taken while the tool hangs in it")


@dataclass(frozen=True)
class ProcedureWorld:
    """What is wrong with the things that the suite's procedures measure by."""

    dome: Vector3 = field(ZERO, low=-0.2, high=0.2, doc="relative error of the dome's rim_x, rim_y, height as drawn")
    run: bool = field(False, doc="calibrate, identify, compare clocks, weigh; else the suite is told what it asks for")
    stiffness: Vector6 = field((1.0,) * 6, low=0.1, high=10.0, doc="factor on the stiffness that it is told, by axis")


@dataclass(frozen=True)
class World:
    """One world."""

    kind: Kind = "spring"
    seed: int = 0
    spring: SpringWorld = SpringWorld()
    images: ImageWorld = ImageWorld()
    cell: CellWorld = CellWorld()
    procedures: ProcedureWorld = ProcedureWorld()
