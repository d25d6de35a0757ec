# SPDX-License-Identifier: Apache-2.0
"""What stands around the arm and what it carries: boxes and planes from a file, hand and tool as capsules."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from seed_core.config import ConfigError, field, load_file
from seed_core.hand import read_hand
from seed_core.vector3 import Vector3, as_vector3, dot, norm, scaled
from seed_driver.clearance_settings import ClearanceSettings
from seed_ur.capsules import HAND, Capsule

# A parallel gripper of the size of a Schunk WSG 50 (146 mm wide) and bubbles of 120 mm; other hands: `parts`.
GRIPPER_RADIUS = 0.075  # [m]
GRIPPER = 0.5, 0.6  # shares of the way from the flange to C between which its axis lies
FINGER_RADIUS = 0.06  # [m] about the line between both cameras
TOOL_RADIUS = 0.03  # [m] about the line from C to the tip


@dataclass(frozen=True)
class Box:
    """A box in the base frame."""

    name: str = field(doc="what a person at the arm calls it")
    position: Vector3 = field(unit="m", low=-10.0, high=10.0, doc="its centre in base")
    size: Vector3 = field(unit="m", low=1e-3, high=20.0, doc="lengths of its edges")
    rpy_deg: Vector3 = field((0.0, 0.0, 0.0), unit="deg", low=-360.0, high=360.0, doc="fixed-axis roll, pitch, yaw")
    tool_may_touch: bool = field(False, doc="tool and fingers are not kept from it: a table to work on")


@dataclass(frozen=True)
class Plane:
    """A plane in the base frame: the arm stays on the side that the normal points to."""

    name: str = field(doc="what a person at the arm calls it")
    point: Vector3 = field(unit="m", low=-10.0, high=10.0, doc="any of its points in base")
    normal: Vector3 = field(low=-1e6, high=1e6, doc="direction out of it, of any length")
    tool_may_touch: bool = field(False, doc="tool and fingers are not kept from it: a table to work on")

    def __post_init__(self) -> None:
        if norm(self.normal) < 1e-6:
            raise ConfigError(f"the normal of plane '{self.name}' is {self.normal}: it must have a length")

    @property
    def unit_normal(self) -> Vector3:
        """The normal, of length 1."""
        return scaled(self.normal, 1.0 / norm(self.normal))

    @property
    def offset(self) -> float:
        """Of the plane normal . x = offset [m]."""
        return dot(self.unit_normal, self.point)


@dataclass(frozen=True)
class Part:
    """Something mounted on the flange, as a capsule in its frame."""

    name: str = field(doc="what a person at the arm calls it")
    start: Vector3 = field(unit="m", low=-2.0, high=2.0, doc="of its axis in the flange's frame")
    end: Vector3 = field(unit="m", low=-2.0, high=2.0, doc="of its axis in the flange's frame")
    radius: float = field(unit="m", low=1e-3, high=1.0, doc="about its axis")
    may_touch: bool = field(False, doc="it works on the floor and on what the tool may touch, as the tool does")


@dataclass(frozen=True)
class Surroundings:
    """The file: `boxes`, `planes` and `parts`, each a list."""

    boxes: tuple[Box, ...] = field((), doc="what stands around the arm")
    planes: tuple[Plane, ...] = field((), doc="walls, ceilings, other tables")
    parts: tuple[Part, ...] = field((), doc="what the flange carries besides hand and tool")

    def __post_init__(self) -> None:
        for kind, things in (("box", self.boxes), ("plane", self.planes), ("part", self.parts)):
            if any(not thing.name for thing in things):
                raise ConfigError(f"a {kind} has no name: give it one, the reason of a hold tells it")


class Carried(NamedTuple):
    """The capsules on the flange: those that keep clear of everything, and those that may touch what is worked on."""

    hard: tuple[Capsule, ...]
    touching: tuple[Capsule, ...]


def read_surroundings(settings: ClearanceSettings) -> Surroundings:
    """The configured file, empty where there is none; raises ConfigError with file, line and what is wrong."""
    path = settings.surroundings_file
    return load_file(Path(path).expanduser(), Surroundings) if path else Surroundings()


def floor_and_planes(settings: ClearanceSettings, surroundings: Surroundings) -> tuple[Plane, ...]:
    """Every plane, the floor first if there is one."""
    if not settings.floor:
        return surroundings.planes
    floor = Plane("floor", (0.0, 0.0, settings.floor_height), (0.0, 0.0, 1.0), tool_may_touch=True)
    return floor, *surroundings.planes


def carried(settings: ClearanceSettings, surroundings: Surroundings) -> Carried:
    """What is on the flange, by the hand's file and the surroundings'; raises ConfigError where a file is wrong."""
    hard = [_capsule(p) for p in surroundings.parts if not p.may_touch]
    soft = [_capsule(p) for p in surroundings.parts if p.may_touch]
    if settings.hand_file:
        hand, tool = read_hand(settings.hand_file)
        C = hand.X_EC[:3, 3]
        near, far = GRIPPER
        ends = [as_vector3((hand.X_EC @ X)[:3, 3]) for X in (hand.X_CL, hand.X_CR)]
        tip = as_vector3((hand.X_EC @ tool.X_Ttip)[:3, 3])
        hard.append(Capsule("gripper", HAND, as_vector3(near * C), as_vector3(far * C), GRIPPER_RADIUS))
        soft.append(Capsule("fingers", HAND, ends[0], ends[1], FINGER_RADIUS))
        soft.append(Capsule("tool", HAND, as_vector3(C), tip, TOOL_RADIUS))
    return Carried(tuple(hard), tuple(soft))


def _capsule(part: Part) -> Capsule:
    return Capsule(part.name, HAND, part.start, part.end, part.radius)
