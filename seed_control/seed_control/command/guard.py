# SPDX-License-Identifier: Apache-2.0
"""Whether the arm may move: it is enabled, and nothing has made it hold since."""

from math import degrees, inf

import numpy as np

from seed_control.parameters import ControllerParameters
from seed_control.state import Counting
from seed_control.wrench.estimate import Measurement
from seed_core.arm.hold import HoldLatch
from seed_core.spatial import Array, rpy_from_rotation
from seed_core.vector3 import Vector3, minus

_IMAGES = 3  # in a row that must agree on an overload


class Guard:
    """Enabled or not, and the latched hold, with what trips it while the arm moves.

    Attributes:
        enabled: since `enable`, until `disable`.
    """

    def __init__(self, parameters: ControllerParameters, counting: Counting) -> None:
        self.parameters, self._counting = parameters, counting
        self._latch = HoldLatch(inf)
        self.enabled = False
        self._too_far = 0  # images in a row
        self._free_from: Vector3 | None = None  # commanded position at which the approach without contact began

    @property
    def held(self) -> str:
        """Why it holds; empty while it does not."""
        return self._latch.reason

    @property
    def following(self) -> bool:
        """Whether set-points are followed."""
        return self.enabled and not self._latch.reason

    def enable(self, on: bool, remark: str = "") -> None:
        """Allow motion or not; either way a hold is over."""
        self._latch.resume()
        self.enabled, self._counting.remark, self._free_from = on, remark, None

    def hold(self, why: str) -> None:
        """Stop, if it moves; the first reason stays."""
        if why:
            self._counting.remark = why
        if why and self.following:
            self._latch.hold(why)
            self._counting.count("holds")

    def check_overload(self, m: Measurement) -> None:
        """Per image: hold when the grasp is deflected or loaded beyond what it endures, in three images in a row."""
        p = self.parameters
        force = float(np.sqrt(m.on_environment.force @ m.on_environment.force))
        deflection = float(np.sqrt(m.X_TC[:3, 3] @ m.X_TC[:3, 3]))
        angle = degrees(max(map(abs, rpy_from_rotation(m.X_TC[:3, :3]).tolist())))
        why = (
            f"estimated force {force:.1f} N is beyond {p.max_measured_force:g} N"
            if force > p.max_measured_force
            else f"deflection {1e3 * deflection:.1f} mm is beyond {1.2e3 * p.max_deflection:.1f} mm: the tool may slip"
            if deflection > 1.2 * p.max_deflection
            else f"rotation {angle:.0f} degrees in the grasp is beyond {1.2 * p.max_rotation:.0f}: the tool may slip"
            if angle > 1.2 * p.max_rotation
            else ""
        )
        self._too_far = self._too_far + 1 if why else 0
        if self._too_far >= _IMAGES and self.enabled:
            self.hold(why)

    def check_free_travel(self, p_WC: Vector3, normals: Array, seeking: bool) -> None:
        """Per step: hold when an approach without contact has gone too far.

        Args:
            p_WC: commanded position [m].
            normals: (m, 3) the force directions.
            seeking: whether contact is sought; the next approach is counted from its own start.
        """
        if not seeking:
            self._free_from = None
            return
        if self._free_from is None:
            self._free_from = p_WC
        travel = normals @ minus(p_WC, self._free_from)
        bound = self.parameters.max_free_travel
        if not float(np.sqrt(travel @ travel)) <= bound:  # nor when it is no number
            self.hold(
                f"no contact within max_free_travel = {1e3 * bound:.0f} mm: start nearer to the surface, or check the "
                "force's sign (what the tool does to the surface) and the estimate"
            )
