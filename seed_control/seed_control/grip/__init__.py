# SPDX-License-Identifier: Apache-2.0
"""How far a grasp is from slipping, and a gripper that answers it."""

from seed_control.grip.control import GripCommand, GripControl
from seed_control.grip.kept_load import KeptLoad
from seed_control.grip.margin import Margin, SlipMargin, SlipSigns
from seed_control.grip.settings import GripSettings
from seed_control.grip.signs import signs_of

__all__ = [
    "GripCommand",
    "GripControl",
    "GripSettings",
    "KeptLoad",
    "Margin",
    "SlipMargin",
    "SlipSigns",
    "signs_of",
]
