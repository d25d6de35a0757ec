# SPDX-License-Identifier: Apache-2.0
"""The cell to look at, as closed triangle meshes, NumPy only: no viewer is chosen here.

Hand, bubbles and tool are in C and T, an arm's links (`seed_ur.meshes`) in its frames, arrows and tables where they are
asked for. What deforms keeps its faces: ten pictures a second cost a few per cent of a core.
"""

from seed_core.meshes.arrows import FORCE_SCALE, TORQUE_SCALE, arrow, ellipsoid, turning_arrow
from seed_core.meshes.bubbles import Bubble, SheetBubble
from seed_core.meshes.hand import BUBBLE, PAPER, WOOD, hand_parts, tool_parts
from seed_core.meshes.shapes import Colour, Mesh, Part, box, capsule, cylinder, hills, joined, slab, sphere, tube

__all__ = [
    "BUBBLE",
    "FORCE_SCALE",
    "PAPER",
    "TORQUE_SCALE",
    "WOOD",
    "Bubble",
    "Colour",
    "Mesh",
    "Part",
    "SheetBubble",
    "arrow",
    "box",
    "capsule",
    "cylinder",
    "ellipsoid",
    "hand_parts",
    "hills",
    "joined",
    "slab",
    "sphere",
    "tool_parts",
    "tube",
    "turning_arrow",
]
