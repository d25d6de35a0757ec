# SPDX-License-Identifier: Apache-2.0
"""What distinguishes the control laws."""

from __future__ import annotations

from dataclasses import dataclass

from seed_core.bushing import Model


@dataclass(frozen=True)
class Features:
    """Switches of one law."""

    synchronise: bool  # kinematics of the image's moment, not of now
    gravity: bool
    model: Model
    observer: bool
    filtered: bool  # low-pass of the tool's pose where there is no observer
    feedforward: bool  # the tool, not the gripper, reaches the reference


LAWS = {
    "seed": Features(True, True, "midpoint", True, True, True),
    "plain": Features(True, True, "midpoint", False, True, True),
    "published": Features(False, False, "plain", False, False, False),
}
