# SPDX-License-Identifier: Apache-2.0
"""Targets that are no poses, old or far away are refused with the number and the bound."""

from math import inf, nan
from typing import Any

import pytest

from seed_core.arm.limits import TargetLimits
from seed_core.arm.quaternion import IDENTITY, from_rotation_vector
from seed_core.arm.target_checks import Target, jump, refusal
from seed_core.vector3 import ZERO

LIMITS = TargetLimits()


def refused(**changes: Any) -> str:
    target = Target(**{"frame": "base", "age": 0.003, "p": ZERO, "q": IDENTITY, **changes})
    return refusal(target, (ZERO, IDENTITY), LIMITS)


def test_a_target_here_and_now_passes() -> None:
    assert refused() == ""
    assert refused(p=(0.0, 0.049, 0.0), q=from_rotation_vector((0.0, 0.0, 0.19)), age=-0.09) == ""
    assert refused(q=(-0.0, -0.0, -0.0, -1.0)) == ""  # the same rotation


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"p": (nan, 0.0, 0.0)}, "target_frame is not finite: position (nan, 0.0, 0.0)"),
        ({"q": (0.0, 0.0, inf, 1.0)}, "target_frame is not finite"),
        ({"q": (0.0, 0.0, 0.0, 0.0)}, "target_frame quaternion has length 0.0000, must be 1"),
        ({"q": (0.0, 0.0, 0.0, 1.1)}, "target_frame quaternion has length 1.1000, must be 1"),
        ({"frame": "base_link"}, "target_frame is in frame 'base_link', must be 'base'"),
        ({"age": 0.5}, "target_frame stamp is 0.500 s old, limit 0.1 s"),
        ({"age": -0.5}, "target_frame stamp is 0.500 s ahead of this computer's clock, limit 0.1 s"),
        ({"p": (0.0, 0.0, 1.7)}, "target_frame z = 1.7 m leaves the workspace -0.6 to 1.6 m"),
        ({"p": (0.0, 1.0, 0.0)}, "target_frame jumps 1 m from the command, limit 0.05 m"),
        (
            {"q": from_rotation_vector((0.0, 0.0, 1.5707963))},
            "target_frame jumps 90.0 degrees from the command, limit 11.5",
        ),
    ],
)
def test_a_bad_target_is_refused_with_the_number(changes: dict[str, Any], reason: str) -> None:
    assert refused(**changes).startswith(reason)


def test_a_jump_may_be_told_from_elsewhere() -> None:
    assert jump((0.2, 0.0, 0.0), ZERO, 0.05, "is {} from the flange") == (
        "target_frame is 0.2 m from the flange, limit 0.05 m"
    )
