# SPDX-License-Identifier: Apache-2.0
"""What turns an estimate of the grasp into the wrench of its spring: the paper's map, or another model."""

from typing import NamedTuple, Protocol

from seed_core.bushing import Stiffness
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, Wrench


class SpringWrench(NamedTuple):
    """The spring's load on the tool about T's origin, written in T.

    Attributes:
        wrench: torque [N m] and force [N].
        covariance: (6, 6) of (torque, force): from the estimate's covariance and from the model's own uncertainty.
        reason: what makes it doubtful (beyond the identified range, say); '' otherwise.
    """

    wrench: Wrench
    covariance: Array
    reason: str = ""


class WrenchModel(Protocol):
    """A model of one grasp.

    Attributes:
        name: as `WrenchEstimate.msg` tells it: 'bushing', 'membrane'.
        stiffness: about the present deflection; the control law takes the deflection to command from it.
    """

    name: str
    stiffness: Stiffness

    def spring(self, estimate: RelativePoseEstimate) -> SpringWrench:
        """The spring's wrench as the estimate shows it; a covariance that is not finite says that it cannot be told."""
        ...
