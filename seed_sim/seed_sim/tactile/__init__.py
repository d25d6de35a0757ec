# SPDX-License-Identifier: Apache-2.0
"""Rendered images of the cameras inside two bubbles that hold a tool (docs/tactile_simulation.md)."""

from seed_sim.tactile.parameters import TactileParameters, ToolShape
from seed_sim.tactile.renderer import MeshRenderer, TactileRenderer

__all__ = ["MeshRenderer", "TactileParameters", "TactileRenderer", "ToolShape"]
