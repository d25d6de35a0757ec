# SPDX-License-Identifier: Apache-2.0
"""Bubbles with mechanics: a pressurised sheet in contact, with friction, that gives force, images and pressure."""

from seed_sim.membrane.grasp import MembraneGrasp
from seed_sim.membrane.parameters import MembraneError, MembraneParameters, random_membrane, unlike_fingers
from seed_sim.membrane.state import BubbleState, GraspState

__all__ = [
    "BubbleState",
    "GraspState",
    "MembraneError",
    "MembraneGrasp",
    "MembraneParameters",
    "random_membrane",
    "unlike_fingers",
]
