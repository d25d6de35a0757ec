# SPDX-License-Identifier: Apache-2.0
"""Limits of motion: one declaration, inherited; a default of one's own changes neither unit nor bounds."""

from dataclasses import dataclass, fields

import pytest

from seed_core.arm.limits import MotionLimits, TargetLimits
from seed_core.config import ConfigError, from_mapping, inherited


@dataclass(frozen=True)
class Gentle(MotionLimits):
    """One with a default of its own."""

    max_speed: float = inherited(MotionLimits, "max_speed", 0.1)


def test_a_default_of_ones_own_keeps_unit_bounds_and_place() -> None:
    assert Gentle().max_speed == 0.1
    assert [f.name for f in fields(Gentle)] == [f.name for f in fields(MotionLimits)]
    assert [f.metadata for f in fields(Gentle)] == [f.metadata for f in fields(MotionLimits)]
    with pytest.raises(ConfigError, match=r"max_speed = 4 m/s must be within 0\.001 and 3 m/s"):
        from_mapping({"max_speed": 4.0}, Gentle)


def test_a_workspace_without_inside_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"workspace_low = \(-1\.4, -1\.4, 2\.0\) m must be below"):
        TargetLimits(workspace_low=(-1.4, -1.4, 2.0))


@pytest.mark.parametrize("limits", [{"max_jerk": 9.9}, {"max_acceleration": 26.0}])
def test_a_jerk_that_would_smooth_targets_for_too_long_is_refused_with_the_acceleration(limits) -> None:
    """The mean over 2 a / j that keeps a jerk makes the command lag by half as much."""
    with pytest.raises(
        ConfigError, match=r"max_jerk = .* m/s\^3 with max_acceleration = .* m/s\^2 .*, at most 0\.2 s: "
    ):
        from_mapping(limits, TargetLimits)
    assert from_mapping({"max_jerk": 10.0, "max_acceleration": 1.0}, TargetLimits).max_jerk == 10.0


@pytest.mark.parametrize(
    ("former", "now"),
    [
        ("max_turning", "max_angular_speed"),
        ("max_turning_acceleration", "max_angular_acceleration"),
        ("max_turning_step", "max_angular_step"),
    ],
)
def test_a_former_name_is_refused_with_the_new_one(former: str, now: str) -> None:
    with pytest.raises(ConfigError, match=f"unknown key '{former}'; it is called '{now}' now"):
        from_mapping({former: 0.3}, TargetLimits)
