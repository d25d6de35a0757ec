# SPDX-License-Identifier: Apache-2.0
"""Rendered colour images of two GelSight-class gels that hold a tool (docs/other_sensors.md)."""

from seed_sim.gel.parameters import GelParameters, gel_hand
from seed_sim.gel.renderer import GelRenderer

__all__ = ["GelParameters", "GelRenderer", "gel_hand"]
