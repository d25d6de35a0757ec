# SPDX-License-Identifier: Apache-2.0
"""Every number of the rendered gels. Sizes are those of a GelSight Mini: 19 x 14 mm in view, 63 dots, 320 x 240 px."""

from dataclasses import dataclass

import numpy as np

from seed_core.config import field
from seed_core.hand import FINGERS_OF, Frame, Hand
from seed_core.vector3 import Vector3
from seed_estimation import PinholeCamera
from seed_sim.tactile.parameters import ToolShape

WIDTH, HEIGHT, VIEW = 320, 240, 0.019  # [px], [px], [m] across the image's width
LENS = (-0.12, 0.05, 0.0004, -0.0003, 0.0)  # k1 k2 p1 p2 k3: a short lens has a barrel distortion of some pixels


@dataclass(frozen=True)
class GelParameters:
    """Gel, dots, lamps and camera. Lamps differ from gel to gel: they are drawn from the seed around these values."""

    tool: ToolShape = field(ToolShape(kind="box", width=0.009, length=0.06), doc="what is held")
    T_held: Frame = field(Frame(), doc="where the middle of what is held lies in T")
    fingers: str = field("both", choices=tuple(FINGERS_OF), doc="which gels have a camera")
    squeeze: float = field(0.0007, unit="m", low=1e-4, high=0.002, doc="imprint of the tool in each gel at the grasp")

    distance: float = field(0.022, unit="m", low=0.01, high=0.1, doc="from the camera to the free gel")
    thickness: float = field(0.003, unit="m", low=0.001, high=0.01, doc="of the gel")
    skirt: float = field(
        0.4, low=0.1, high=2.0, doc="way beside the tool over which an imprint falls by e, thicknesses"
    )
    drag: float = field(0.6, low=0.1, high=2.0, doc="way over which a sideways motion falls by e, in thicknesses")
    bulge: float = field(0.15, low=0.0, high=0.5, doc="share of an imprint that rises around it: gel keeps its volume")
    spread: float = field(
        0.1, low=0.0, high=1.0, doc="sideways flow of pressed gel, per slope of its imprint, in thicknesses"
    )
    slip: float = field(0.0, low=0.0, high=0.9, doc="share of the tool's sideways motion that the gel does not follow")
    creep: float = field(0.0005, unit="m", low=0.0, high=0.005, doc="width of the patch's edge that does not stick")

    dot_pitch: float = field(0.0021, unit="m", low=5e-4, high=0.01, doc="of the dots' grid")
    dot_radius: float = field(0.00026, unit="m", low=5e-5, high=0.002, doc="of a dot")
    dot_jitter: float = field(0.03, low=0.0, high=0.3, doc="deviation of a dot from its place, in pitches")

    lamp_spread: float = field(0.2, low=0.0, high=0.8, doc="deviation of the lamps' brightness from each other")
    crosstalk: float = field(0.12, low=0.0, high=0.5, doc="share of a lamp that the other colours' pixels see")
    gloss: float = field(0.25, low=0.0, high=2.0, doc="of the coat, against its diffuse part")
    gamma: tuple[float, float] = field(
        (1.8, 2.4), low=1.0, high=3.0, span=True, doc="least and largest exponent of the camera"
    )
    blur: float = field(0.9, unit="px", low=0.0, high=5.0, doc="deviation of the lens' blur")
    noise: float = field(1.0, low=0.0, high=20.0, doc="scale of the image noise: 1 is 1.2 counts at mid grey")


def gel_camera(p: GelParameters) -> PinholeCamera:
    """The camera behind a gel."""
    f = WIDTH * p.distance / VIEW
    K = np.array(((f, 0.0, 161.3), (0.0, f, 118.2), (0.0, 0.0, 1.0)))
    return PinholeCamera(WIDTH, HEIGHT, K, np.array(LENS), "plumb_bob")


def gel_hand(p: GelParameters) -> Hand:
    """A hand whose fingers have closed on the tool: its surface lies `squeeze` behind that of each free gel."""
    y = p.tool.radius - p.squeeze + p.distance
    left: Vector3 = (0.0, y, 0.0)
    right: Vector3 = (0.0, -y, 0.0)
    return Hand(name="gel", C_L=Frame(left, (90.0, 0.0, 0.0)), C_R=Frame(right, (-90.0, 0.0, 0.0)))
