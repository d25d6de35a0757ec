# SPDX-License-Identifier: Apache-2.0
"""The hand and the tool in it: frames, weight, stiffness of a grasp, and pressure by width of the gripper."""

from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from seed_core.bushing import Stiffness
from seed_core.config import ConfigError, field, from_mapping, load_text, plain_yaml
from seed_core.spatial import Array, Wrench, cross, pose_from_rpy
from seed_core.vector3 import Vector3, norm

FloatOrArray = TypeVar("FloatOrArray", float, Array)
FINGERS = ("left", "right")  # as they are named everywhere; the left one is on the side of +y of C
FINGERS_OF = {"both": FINGERS, "left": ("left",), "right": ("right",)}  # by what a parameter `fingers` may be
UPRIGHT: Vector3 = (0.0, 0.0, 1.0)  # against gravity, in the base of an arm that stands
GRAVITY = 9.81  # [m/s^2]
DEFAULT_STIFFNESS = Stiffness(rotation=(4.0, 3.0, 4.0), translation=(800.0, 1200.0, 800.0))


@dataclass(frozen=True)
class Frame:
    """A fixed pose of a child frame in its parent."""

    position: Vector3 = field((0.0, 0.0, 0.0), unit="m", low=-5.0, high=5.0, doc="origin of the child in the parent")
    rpy_deg: Vector3 = field(
        (0.0, 0.0, 0.0), unit="deg", low=-360.0, high=360.0, doc="fixed-axis roll, pitch, yaw of the child"
    )

    @property
    def pose(self) -> Array:
        """X (4, 4)."""
        return pose_from_rpy(np.deg2rad(self.rpy_deg), self.position)


@dataclass(frozen=True)
class Hand:
    """Frames fixed on the gripper: C in the flange E, and both optical frames in C.

    The defaults are a parallel gripper with two bubbles whose cameras look along +y_C (right finger) and -y_C
    (left finger), 105 mm from the grasp's centre. Columns of both images run along x_C; rows along z_C (left),
    -z_C (right).
    """

    name: str = field("soft_bubble", doc="name of this hand")
    E_C: Frame = field(Frame((0.0, 0.0, 0.15)), doc="compliance frame C in the flange E (tool0)")
    C_L: Frame = field(Frame((0.0, 0.105, 0.0), (90.0, 0.0, 0.0)), doc="left optical frame in C; looks along -y_C")
    C_R: Frame = field(Frame((0.0, -0.105, 0.0), (-90.0, 0.0, 0.0)), doc="right optical frame in C; looks along +y_C")
    up: Vector3 = field(
        UPRIGHT, low=-1.0, high=1.0, doc="unit vector against gravity, in base; 0 0 -1 for an arm on a ceiling"
    )

    def __post_init__(self) -> None:
        size = norm(self.up)
        if abs(size - 1.0) > 1e-3:
            raise ConfigError(f"up = {self.up} has length {size:g}; give a unit vector")

    @property
    def X_EC(self) -> Array:
        return self.E_C.pose

    @property
    def X_CL(self) -> Array:
        return self.C_L.pose

    @property
    def X_CR(self) -> Array:
        return self.C_R.pose


@dataclass(frozen=True)
class Tool:
    """What is held: its working point and its weight, in T, which equals C at the moment of grasp."""

    name: str = field("squeegee", doc="name of this tool")
    T_tip: Frame = field(Frame((0.0, 0.0, 0.12)), doc="tip frame in T: where the tool works")
    mass: float = field(0.2, unit="kg", low=0.0, high=20.0, doc="mass of the tool")
    center_of_mass: Vector3 = field((0.0, 0.0, 0.06), unit="m", low=-1.0, high=1.0, doc="centre of mass in T")

    @property
    def X_Ttip(self) -> Array:
        return self.T_tip.pose


def read_hand(path: str, alone: bool = False) -> tuple[Hand, Tool]:
    """Hand and tool of the launch files' hand_file.

    Args:
        alone: a file of nothing but the hand serves as well.

    Raises:
        ConfigError: it cannot be read, or is another kind of file.
    """
    try:
        text = Path(path).expanduser().read_text(encoding="utf-8")
    except (OSError, RuntimeError, ValueError) as error:
        raise ConfigError(f"hand_file = {path!r} cannot be read: {error}") from error
    data = plain_yaml(text, path)
    sections = list(data.values()) if isinstance(data, dict) else []
    for section in sections:
        parameters = section.get("ros__parameters") if isinstance(section, dict) else None
        if isinstance(parameters, dict) and "hand" in parameters:
            return (
                from_mapping(_mapping(parameters, "hand", path), Hand, f"{path}: hand"),
                from_mapping(_mapping(parameters, "tool", path), Tool, f"{path}: tool"),
            )
    if alone:
        return load_text(text, Hand, path), Tool()
    raise ConfigError(f"hand_file = {path!r} has no 'hand' under ros__parameters: is it the launch's hand_file?")


def _mapping(parameters: dict[str, object], name: str, path: str) -> dict[str, object]:
    value = parameters.get(name, {})
    if not isinstance(value, dict):
        raise ConfigError(f"{path}: {name} = {value!r} must be a mapping")
    return value


def weight_about_T(mass: float, center_of_mass: ArrayLike, R_WT: Array, up: ArrayLike = UPRIGHT) -> Wrench:
    """Load of gravity on the tool about T's origin, written in T; what the paper left out is m g of the force.

    Args:
        mass: [kg].
        center_of_mass: (3,) [m] in T.
        R_WT: (3, 3) orientation of the tool. up: (3,) against gravity, in W.
    """
    force = np.asarray(up) @ R_WT * (-mass * GRAVITY)
    return Wrench(cross(np.asarray(center_of_mass), force), force)


@dataclass(frozen=True)
class GripperPressure:
    """The gripper model (Fig. 2): the pressure in both bubbles rises linearly as the gripper closes on them.

    Attributes:
        width: [m] some width; pressure: [hPa] the absolute pressure there.
        slope: [hPa/m] rise of pressure per closed metre, 0 or more.
    """

    width: float
    pressure: float
    slope: float

    def at_width(self, width: FloatOrArray) -> FloatOrArray:
        """Pressure [hPa] at a gripper width [m]."""
        return self.pressure + self.slope * (self.width - width)
