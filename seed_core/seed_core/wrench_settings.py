# SPDX-License-Identifier: Apache-2.0
"""Where the wrench comes from, what it is checked against, and how well that is known; each with unit and bound."""

from dataclasses import dataclass
from typing import Literal, get_args

from seed_core.config import field
from seed_core.wrench_model import MapUncertainty

WrenchModelName = Literal["bushing", "hysteretic", "membrane"]
WRENCH_MODELS: tuple[WrenchModelName, ...] = get_args(WrenchModelName)


@dataclass(frozen=True)
class WrenchSettings(MapUncertainty):
    """The model and the file of its identification."""

    model: str = field(
        "bushing",
        choices=WRENCH_MODELS,
        doc="bushing: the paper's map of the tool's pose; hysteretic: a spring that stiffens and has friction; "
        "membrane: a map of what the membranes do",
    )
    file: str = field(
        "",
        doc="membrane_map.yaml or hysteretic_spring.yaml; of a bushing stiffness.yaml, for deviations, age and what is "
        "unexplained: that of grip.file where none is given",
    )


@dataclass(frozen=True)
class ReferenceSettings:
    """Tool's weight, the arm's own force/torque reading, and what a contradiction does.

    The defaults of the arm's reading are a UR e-series' (accuracy 4 N, 0.2 N m; better once zeroed in free space).
    """

    # A hold leaves the tool pressed as it is, and the reference may be what is wrong (an arm's own reading is less
    # accurate than a good identification), so by default a contradiction is told, and mended within bounds.
    on_contradiction: str = field("warn", choices=("warn", "hold"), doc="what a contradiction of the wrench does")
    correct: bool = field(True, doc="let weight and arm_wrench correct the wrench, slowly and within correction_*")
    correction_offset: float = field(2.5, unit="N", low=0.0, high=20.0, doc="most of a correction whatever the force")
    correction_share: float = field(0.3, low=0.0, high=0.6, doc="of the force by which it may be corrected besides")
    force_tolerance: float = field(0.25, unit="N", low=0.0, high=10.0, doc="difference that is not told")
    torque_tolerance: float = field(0.05, unit="N m", low=0.0, high=2.0, doc="likewise")
    share_tolerance: float = field(0.035, low=0.0, high=1.0, doc="of the force: likewise")
    mass_deviation: float = field(0.03, low=0.0, high=1.0, doc="relative standard deviation of the tool's mass")
    centre_deviation: float = field(2.0, unit="mm", low=0.0, high=50.0, doc="of its centre of mass")
    arm_weighs_tool: bool = field(True, doc="arm_wrench contains the tool's weight (its payload setting does not)")
    arm_force_noise: float = field(0.5, unit="N", low=0.0, high=20.0, doc="of a single reading")
    arm_torque_noise: float = field(0.05, unit="N m", low=0.0, high=2.0, doc="of a single reading")
    arm_force_offset: float = field(
        0.4, unit="N", low=0.0, high=20.0, doc="of the reading once it was zeroed, as the arm turns and warms up"
    )
    arm_torque_offset: float = field(0.05, unit="N m", low=0.0, high=2.0, doc="likewise")
    arm_gain: float = field(0.01, low=0.0, high=0.5, doc="relative error of the reading's gain")
    arm_timeout: float = field(0.5, unit="s", low=0.05, high=10.0, doc="longest gap between readings")
