# SPDX-License-Identifier: Apache-2.0
"""Whether the zero of the grasp can be right, told without any image of the membranes.

Two things show a grasp that was taken under load, whichever estimator gives the poses. A force that was there, and is
gone after a new grasp though the arm has not moved. And a force that stays while the tool approaches through free air,
where there can be none. A third casts doubt on it: a pose that jumped in contact. Such a doubt outlasts a hold, until
the tool is seen in free air without a force, or the grasp is taken anew.
"""

from collections import deque
from math import degrees

import numpy as np

from seed_control.wrench.estimate import Measurement
from seed_core.estimate import NEW_GRASP
from seed_core.hand import GRAVITY, UPRIGHT, Tool
from seed_core.spatial import Array, length, so3_log
from seed_core.vector3 import Vector3

SOFTEST = 100.0  # [N/m] of a surface that is told from free air
_CERTAIN = 2.0  # deviations of the force's rise per way, for either
_WAY = 4e-3  # [m] along the force that an approach has to go, and further than across
_ONE_WAY = 0.7  # of the way, by which its end is from its start
_STEADY = 0.5, 3.0  # [N], and deviations, within which a force stays in free air
_MOST = 100  # images of it that are kept
_STAYED = 0.03, 0.1  # [m], and of a rotation matrix: an arm that has gone further may have left what it pressed
_LEAST, _SHARE = 1.0, 0.3  # [N], and of the force before, by which a force that is kept may differ
_NOISE = 4.0  # deviations of the estimated force
_AVERAGED = 8  # images before a new grasp, and after it, that are compared
_NEAR = 1e-3  # [m] within which the gripper stood in those before
_TURNED = 6.0  # deviations of a rotation by which a pose that has jumped is another
_ALIKE = 0.25  # of the weight, by which a force may differ that a hanging tool explains
_NONE = np.zeros((0, 3)), np.zeros((0, 3))  # places and forces of no image
_LIFT = 0.01  # [m] that are enough to see free air, with what has to be let go first


class GraspCheck:
    """`update` with each image, `new_grasp` where T is counted anew, `let_go` where the gripper is empty.

    Attributes:
        reason: why force must not be controlled with this grasp; '' while nothing speaks against it.
        weight: of the tool [N].
    """

    def __init__(self, tool: Tool, most: float, up: Vector3 = UPRIGHT) -> None:
        """most: [N] that a tool in free air may seem to press. up: against gravity, in W."""
        self.weight, self._most, self._up = tool.mass * GRAVITY, most, np.array(up)
        self._anew = self._loaded = self._doubted = ""
        self._doubt = ""  # that the zero is right, since the tool last hung free
        self._pressed: Array | None = None  # direction (3,) of the last force that was wanted
        self._recent: deque[Measurement] = deque(maxlen=_AVERAGED)
        self._before: tuple[Measurement, ...] = ()  # the last ones of the grasp before, alike
        self._gone: list[Array] = []  # force that each image of the new grasp lacks
        self._taken = False  # a new grasp has been taken since
        self._why = NEW_GRASP
        self._touched: Array | None = None  # (3,) [m] place p_WC where it touched, as long as it has pressed since
        self._free = False  # free air without a force was seen, and no touch since
        self._rows: tuple[Array, Array] | None = _NONE  # of an approach: p_WC [m], force, (N, 3); None: it is judged

    @property
    def reason(self) -> str:
        """The first thing that speaks against it."""
        return self._anew or self._doubted or self._loaded

    def doubt(self, why: str) -> None:
        """Something spoke against the zero while force was controlled, and did not make it hold."""
        self._doubt = why or self._doubt

    def restart(self) -> None:
        """Enabled anew: an approach is to show again what it has shown, unless it has pressed all along."""
        self._loaded, self._rows = "", _NONE if self._touched is None else None
        if self._doubt:
            self._refuse_doubted()

    def _refuse_doubted(self) -> None:
        self._doubted = (
            f"{self._doubt}, and the tool has not hung free since: lift it off by {1e3 * _LIFT:.0f} mm, so that "
            "free air shows whether forces are right, or initialize the grasp free of load"
        )

    def let_go(self) -> None:
        """The gripper held nothing: whatever the tool bore then, the next grasp owes it nothing."""
        self._recent.clear()
        self._before = ()

    def new_grasp(self, why: str) -> None:
        """T is counted anew (why: NEW_GRASP), or poses have jumped ('')."""
        if not self._taken:
            images = list(self._recent)
            self._before = tuple(m for m in images if length(m.X_WC[:3, 3] - images[-1].X_WC[:3, 3]) <= _NEAR)
            self._taken = True
            self._recent.clear()
        self._why, self._gone, self._touched, self._free = why, [], None, False
        self._anew = ""
        if why:
            self._doubt = self._doubted = ""
        self.restart()

    def update(self, m: Measurement, pressing: Array | None, stiffness: float) -> None:
        """Take in a measurement.

        Args:
            pressing: (3,) direction of the wanted force, in W; None where none is, or along several directions.
            stiffness: of the grasp [N/m].
        """
        if self._taken:
            self._taken = False
            self._gone = []
        if self._before:
            self._compare(m, stiffness)
        self._recent.append(m)
        self._follow_touch(m, stiffness)
        if pressing is not None:
            self._pressed = pressing
        elif self._doubt and self._pressed is not None:
            self._rows = self._rows if self._rows is not None else _NONE
            pressing = self._pressed
        if pressing is None:
            self._rows = _NONE
        elif self._rows is not None:
            self._approach(m, pressing, stiffness * m.variance**0.5)

    def _compare(self, m: Measurement, stiffness: float) -> None:
        """The first images of a new grasp with the last of the one before."""
        before, last = self._before, self._before[-1]
        step = m.X_WC[:3, 3] - last.X_WC[:3, 3]
        turn = float(np.abs(m.X_WC[:3, :3] - last.X_WC[:3, :3]).max())
        if length(step) > _STAYED[0] or turn > _STAYED[1]:
            self._before = ()
            return
        first = not self._gone
        was = np.sum([b.on_environment.force for b in before], axis=0) / len(before)
        size = length(was)
        noise = _NOISE * stiffness * (last.variance / len(before) + m.variance / (len(self._gone) + 1)) ** 0.5
        if size > max(_LEAST, noise):  # it touched: the arm's way since has pressed it further, or released it
            was = was * max(1.0 + stiffness * float(step @ was) / size**2, 0.0)
        self._gone.append(was - m.on_environment.force)
        lacks = np.sum(self._gone, axis=0) / len(self._gone)
        gone, borne = length(lacks), max(size, length(was))
        turned = so3_log(last.X_CT[:3, :3].T @ m.X_CT[:3, :3])
        angle = length(turned) if first and not self._why else 0.0
        if len(self._gone) >= _AVERAGED:
            self._before = ()
        if gone <= max(_LEAST, _SHARE * size, noise) and angle <= _TURNED * m.rotation_deviation:
            if not self._before and not self._why and gone > max(_LEAST, noise):
                self._doubt = f"the tool's pose has jumped, and {gone:.1f} of {borne:.1f} N are gone since"
                self._refuse_doubted()
            return
        self._before = ()
        what = "the grasp was taken anew while the tool was loaded" if self._why else "the tool's pose has jumped"
        if angle > _TURNED * m.rotation_deviation:
            what += f" by {degrees(angle):.1f} degrees"
        self._anew = (
            f"{what}: {gone:.1f} of {borne:.1f} N are gone though the arm has not moved back, so forces would be off "
            "by as much: initialize the grasp free of load"
        )

    def _approach(self, m: Measurement, pressing: Array, noise: float) -> None:
        """Where the gripper goes on and the force does not rise, there is no contact and no force."""
        assert self._rows is not None
        rows, new = self._rows, (m.X_WC[:3, 3], m.on_environment.force)
        places, forces = (np.concatenate((a[1 - _MOST :], b[None])) for a, b in zip(rows, new, strict=True))
        self._rows = places, forces
        heights = places @ pressing
        gone = float(heights.max() - heights.min())
        if gone < _WAY or gone < float(np.ptp(places - np.outer(heights, pressing), axis=0).max()):
            return  # a surface may rise and fall under a tool that wipes
        way = heights - heights.mean()
        square = float(way @ way)
        along = forces @ pressing
        rise = float(way @ along) / square  # [N/m]
        deviation = _CERTAIN * noise / square**0.5
        if rise - deviation > SOFTEST:  # it touches
            self._rows, self._touched = None, m.X_WC[:3, 3]
        elif rise + deviation < SOFTEST and not _follows(heights, along - rise * way, noise):
            self._judge(forces.mean(axis=0), noise / len(heights) ** 0.5)
            self._rows = None

    def _follow_touch(self, m: Measurement, stiffness: float) -> None:
        """Whether the tool has pressed ever since it came out of free air."""
        force = m.on_environment.force
        presses = float(force @ force) > max(_LEAST, _NOISE * stiffness * m.variance**0.5) ** 2
        if self._touched is None:
            if self._free and presses:
                self._touched, self._free = m.X_WC[:3, 3], False
        elif self._doubt or not presses or length(m.X_WC[:3, 3] - self._touched) > _STAYED[0]:
            self._touched = None

    def _judge(self, force: Array, deviation: float) -> None:
        """A force (3,) [N] that was seen in free air."""
        size = length(force)
        if size <= self._most + _NOISE * deviation:
            self._doubt = self._doubted = ""
            self._free = True
            return
        hung = float(np.abs(force + self.weight * self._up).max()) < _ALIKE * self.weight
        why = f"the grasp was taken while the tool hung ({self.weight:.1f} N)" if hung else "the grasp was loaded then"
        self._loaded = (
            f"in free air the tool seems to press with {size:.1f} N, more than {self._most:g} N: {why}, or weight or "
            "stiffness are wrong; initialize the grasp free of load, or weigh the tool"
        )


def _follows(heights: Array, rest: Array, noise: float) -> bool:
    """Whether the gripper follows a surface that moves: it turns back, or the `rest` of the force changes by itself."""
    turns = abs(float(heights[-1] - heights[0])) < _ONE_WAY * float(heights.max() - heights.min())
    return turns or float(np.std(rest)) > max(_STEADY[0], _STEADY[1] * noise)
