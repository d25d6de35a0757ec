# SPDX-License-Identifier: Apache-2.0
"""What the page shows of one moment, whether it comes from a running cell or from a bag."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_core.hand import Tool
from seed_core.meshes import Mesh
from seed_core.spatial import Array

SPAN = 20.0  # [s] that the plots show


@dataclass(frozen=True)
class ControlView:
    """The controller's words and forces; forces of the tool on the environment, in the task frame.

    Attributes:
        mode: disabled, holding, idle, position, approach or contact.
        wanted, measured, deviation: (6,) force x y z [N], torque x y z [N m]; deviation: one standard deviation.
    """

    stamp: float
    enabled: bool
    mode: str
    reason: str
    in_contact: bool
    settled: bool
    wanted: Array
    measured: Array
    deviation: Array


@dataclass(frozen=True)
class GraspView:
    """The pose of the tool in the grasp, and how well it sticks there.

    Attributes:
        X_CT: (4, 4).
        slip: share of the tool's motion that the membrane does not follow, 0 to 1.
    """

    X_CT: Array
    valid: bool
    reason: str
    slip: float
    gross_slip: bool


@dataclass(frozen=True)
class WrenchView:
    """The wrench of the tool on the environment about the tip, in W.

    Attributes:
        force, torque: (3,) [N], [N m].
        covariance: (6, 6), force first.
    """

    force: Array
    torque: Array
    covariance: Array
    doubt: str


class DepthView(NamedTuple):
    """image: (H, W) [m]; intrinsics: fx, fy, cx, cy [px]."""

    image: NDArray[np.float32]
    intrinsics: tuple[float, float, float, float]


@dataclass(frozen=True)
class CellState:
    """One moment of a cell; None and empty where nothing tells it.

    Attributes:
        now: stamp of the controller's state, without one the newest of all [s]; nan before the first.
        X_WE, X_WS: flange and table (4, 4) in W. table: its shape; as long as nothing tells it, it is drawn flat.
        joints: (6,) [rad].
        fixed: pose (4, 4) of each fixed frame in its parent, by (parent, child).
        tool: what is held, if that is known.
        depths: what each bubble's camera sees of its membrane.
        picture: (H, W, 3) uint8 RGB of both tactile images side by side.
        contact: area [m^2] of each bubble's contact.
        arm: its name; arm_holds: why it follows nothing.
        missing: what keeps a task from being played, by part.
        silent: [s] since the cell said anything.
    """

    now: float = nan
    X_WE: Array | None = None
    X_WS: Array | None = None
    table: Mesh | None = None
    joints: Array | None = None
    fixed: Mapping[tuple[str, str], Array] = field(default_factory=dict)
    control: ControlView | None = None
    grasp: GraspView | None = None
    touch: WrenchView | None = None
    tool: Tool | None = None
    depths: Mapping[str, DepthView] = field(default_factory=dict)
    picture: NDArray[np.uint8] | None = None
    contact: Mapping[str, float] = field(default_factory=dict)
    arm: str = ""
    arm_holds: str = ""
    missing: Mapping[str, str] = field(default_factory=dict)
    real_time_factor: float | None = None
    silent: float = 0.0

    @property
    def alive(self) -> bool:
        """Whether there is anything to show."""
        return not isnan(self.now)


class History:
    """Force and torque, wanted and measured, of the last seconds."""

    def __init__(self, span: float = SPAN) -> None:
        self.span = span
        self._rows: deque[tuple[float, Array, Array, Array]] = deque()

    def add(self, control: ControlView | None) -> None:
        """One more moment; time that goes back begins anew."""
        if control is None:
            return
        if self._rows and control.stamp <= self._rows[-1][0]:
            if control.stamp == self._rows[-1][0]:
                return
            self._rows.clear()
        self._rows.append((control.stamp, control.wanted, control.measured, control.deviation))
        while self._rows[0][0] < control.stamp - self.span:
            self._rows.popleft()

    def clear(self) -> None:
        """Forget it."""
        self._rows.clear()

    def axis(self, of: slice, otherwise: int) -> int:
        """The axis on which most was wanted lately, of `of`; `otherwise` if nothing was."""
        if not self._rows:
            return otherwise
        most = np.max(np.abs([wanted[of] for _, wanted, _, _ in self._rows]), axis=0)
        return int(of.start + np.argmax(most)) if most.max() > 0.0 else otherwise

    def series(self, axis: int, now: float) -> tuple[Array, Array, Array, Array, Array]:
        """Seconds before `now` (negative), wanted, measured, and measured less and plus two deviations."""
        if not self._rows:
            empty = np.zeros(0)
            return empty, empty, empty, empty, empty
        rows = np.array([(t - now, w[axis], m[axis], d[axis]) for t, w, m, d in self._rows])
        ago, wanted, measured, deviation = rows.T
        spread = 2.0 * np.nan_to_num(deviation)
        return ago, wanted, measured, measured - spread, measured + spread
