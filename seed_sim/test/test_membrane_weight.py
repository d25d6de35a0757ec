# SPDX-License-Identifier: Apache-2.0
"""A known weight in known attitudes tells the membranes' slopes from images alone, and no more than it loads."""

from dataclasses import replace

import pytest

from seed_sim.identification.membrane_weight import identify_membranes_with_weight
from seed_sim.identification.scenario import IdentificationScenario, Weight, identify_on_membrane, load
from seed_sysid.fit.weight import WeightError

ATTITUDES = ((0, 0), (60, 0), (120, 0), (120, 40), (90, 70), (30, 80), (0, 60))


def held(mass: float) -> IdentificationScenario:
    drawn = identify_on_membrane(load("default"), 77)
    return replace(drawn, weight=Weight(mass=mass), membrane=replace(drawn.membrane, spacing=0.0055))


def test_a_weight_at_the_tools_frame_gives_the_forces_with_intervals() -> None:
    found, figures = identify_membranes_with_weight(held(0.5), 3, ATTITUDES)
    assert (found.half_width[3:] < 0.1 * found.slope[3:]).all()
    assert figures["lighter"]["load"] > 2.0  # [N]: of half the weight, which the fit has not seen
    assert figures["lighter"]["off"] < 0.1 * figures["lighter"]["load"]
    assert set(found.undetermined) == {"roll", "pitch", "yaw"}  # what a tool that hangs lower puts on them is no lever
    assert figures["slope"]["pitch"] is None


def test_a_weight_that_tears_the_tool_out_is_refused() -> None:
    with pytest.raises(WeightError, match=r"(tear the tool out|lost the tool)"):
        identify_membranes_with_weight(held(9.0), 3, ATTITUDES)
