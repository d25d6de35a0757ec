# SPDX-License-Identifier: Apache-2.0
"""Names of the frames, the same parameters in every node."""

from dataclasses import dataclass

from seed_core.config import field


@dataclass(frozen=True)
class FrameNames:
    """See docs/notation.md for where each frame lies."""

    base: str = field("base", doc="W, in which the arm is commanded")
    flange: str = field("tool0", doc="E, the flange of the arm")
    compliance: str = field("compliance", doc="C, fixed on the gripper at the nominal grasp point")
    tool: str = field("tool", doc="T, fixed in the tool, equal to C at the moment of grasp")
    tip: str = field("tip", doc="where the tool works")
    left_camera: str = field("bubble_left_optical", doc="L, optical frame of the left camera")
    right_camera: str = field("bubble_right_optical", doc="R, optical frame of the right camera")

    def camera(self, finger: str) -> str:
        """Optical frame of 'left' or 'right'."""
        return self.left_camera if finger == "left" else self.right_camera
