# SPDX-License-Identifier: Apache-2.0
"""The full law: Algorithm 2 with what it takes to hold force, torque, position and angle on a real arm.

The default law `seed` is HybridLaw with the surface observer, the law `plain` the same without it.
"""

from collections import deque
from math import inf
from typing import NamedTuple, TypeGuard

import numpy as np

from seed_control.law.force_change import ForceChange
from seed_control.law.published import PublishedLaw
from seed_control.law.surface_normal import SurfaceNormal
from seed_control.law.surface_observer import SurfaceObserver
from seed_control.law.tip_reference import HeightReference
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import NO_AXES, AxisFlags, HybridSetpoint
from seed_control.wrench.estimate import Measurement, WrenchEstimator, low_pass_share
from seed_control.wrench.filters import DeflectionFilter
from seed_core.bushing import Model, Stiffness
from seed_core.spatial import Array, cross, length, rotation_from_rpy, so3_log
from seed_core.vector3 import ZERO, Vector3, as_vector3, dot

_APPROACH_SHARE = 0.7  # of the wanted deflection that an approach may cover before the first image of contact acts
_LEAST_MARGIN = 0.1  # of stiffness against tipping that is still told apart
_LEAST_LEVER = 0.01  # [m] at which a side force counts
_LEAST_SPEED = 1e-6  # [m/s] across the tool's lever, below which a path goes nowhere that a tip could trail
_TURNING = 0.3  # cost of turning the grasp, over that of shifting it by as much at the tip
_OVER, _NOISE = 0.5, 3.0  # share of `max_excess_force`, and deviations of a force, beyond which nothing is pressed on
_KNOWN = 3.0  # times `press_speed`, at which a force that has been there may be changed
_ROUGH = (0.45, 0.7)  # friction from which on, and up to which, a tool is kept from springing ahead
_TRAILING = 0.25  # share of the grasp's turn that stays as lean on a rough surface
_FORGET = 2.0  # [s] over which friction is taken back
_PRESS_TIME = 0.1  # [s] in which the force may be built up at the soonest, once the surface is known


class Side(NamedTuple):
    """A direction across force and path in which the tip's force is as good as a torque.

    Attributes:
        e: (3,) in W. stiffness: of the grasp along it [N/m].
        turning: share of a force along it that turning the grasp balances, for the least turn and shift together.
    """

    e: Array
    stiffness: float
    turning: float


class HybridLaw(PublishedLaw):
    """Algorithm 2 on the image's own kinematics, with gravity, a smoothed tool, and the tool instead of the gripper
    on the path: the deflection of what is held is fed forward.

    In contact an observer per force direction tells where the surface will be (law `seed`; `plain` goes without).
    """

    synchronised = True
    gravity = True
    model: Model = "midpoint"
    smoothed = True

    def __init__(self, parameters: ControllerParameters, wrench_estimator: WrenchEstimator) -> None:
        super().__init__(parameters, wrench_estimator)
        self.observers: list[SurfaceObserver] = []  # one per force direction, since contact was made along it
        self.deflection = DeflectionFilter(parameters)
        self.normal = SurfaceNormal()  # of the task frame 'found'
        self._tipping_gain = 1.0
        self._pressing_T: Array | None = None  # (3,) unit vector of the wanted force
        self._upright = 1.0  # share of the grasp's turn that is fed forward
        self._ahead = 0.0  # [s] from an image to when the arm begins to answer it
        self._off_path = ZERO  # [m] from where the path was at the newest image to the tip, which trails, or sticks
        self._turns: deque[tuple[float, Array]] = deque(maxlen=100)  # stamps [s], rpy in the grasp given with them
        self._loop_time = inf  # [s]
        self._friction = 0.0  # of the tool on the surface, the most of lately
        self._changes: list[ForceChange] = []  # one per force direction, since the force was there after contact
        self._asked: deque[tuple[float, list[float]]] = deque(maxlen=500)  # newest stamp [s], forces wanted [N]

    def set_limits(self, parameters: ControllerParameters) -> None:
        super().set_limits(parameters)
        self.deflection.parameters = parameters

    def image(self, m: Measurement, loop_time: float, age: float = 0.0) -> None:
        frame = m.stamp - self.measured.stamp if self.measured is not None else 0.0
        self._ahead = max(loop_time - 0.5 * max(frame, 0.0), 0.0)
        while len(self._asked) > 1 and self._asked[1][0] < m.stamp - loop_time - frame:
            self._asked.popleft()
        s = self.setpoint
        if s is not None:
            self._off_path = as_vector3(m.tip - s.X_W_tip[:3, 3] + age * s.velocity)
        R_WT_des = s.X_W_tip[:3, :3] @ self._R_Ttip.T if s is not None else None
        x, y, z = (not (on and self.contact.made) for on in (s.torque_axes if s is not None else NO_AXES))
        self.trailing = self._trails(s, R_WT_des, (x, y, z), m) if s is not None and R_WT_des is not None else None
        pressing = self._pressing_T if self.contact.made else None
        self.deflection.update(m, loop_time, self._tipping_gain, self._yielding(), R_WT_des, (x, y, z), pressing)
        self._loop_time = loop_time
        self._turns.append((m.stamp, self._upright * self.deflection.q))
        if self._follows_surface(s) and self.touches(0):
            self.normal.image(m, s, self.wrench_estimator.mean_stiffness, loop_time)
            self.tool.turn(self.deflection.turned[0])
        super().image(m, loop_time, age)
        self._feel_friction(max(frame, 0.0))

    def _feel_friction(self, dt: float) -> None:
        """Friction of the tool on the one surface that it is pressed on; a tip that sticks shows less of it.

        Where the surface's normal is being found, what is across it may be a slope's.
        """
        if self._follows_surface(self.setpoint) or len(self.plan.normals) != 1 or not self.touches(0):
            return
        n, force = self.plan.normals[0], self.tool.on_environment.force
        pressing = float(n @ force)
        wanted = abs(float(self.plan.wanted[0]))
        if not wanted or not pressing or abs(pressing) < 0.5 * wanted:
            return
        across = force - pressing * n
        ratio = length(across) / abs(pressing)
        self._friction = max(ratio, self._friction + low_pass_share(dt, _FORGET) * (ratio - self._friction))

    @property
    def _rough(self) -> float:
        """0 to 1: how much a tool has to be kept from springing ahead."""
        return min(max((self._friction - _ROUGH[0]) / (_ROUGH[1] - _ROUGH[0]), 0.0), 1.0)

    def _may_change(self) -> None:
        """Once the force has been there, the way to another is known, until contact is lost."""
        count, p = len(self.plan.normals), self.parameters
        if not all(map(self.touches, range(count))):
            self._changes = []
        elif self.settled and len(self._changes) != count:
            self._changes = [ForceChange(p.max_acceleration, p.max_jerk) for _ in range(count)]

    def _trails(self, s: HybridSetpoint, R_WT_des: Array, held: AxisFlags, m: Measurement) -> float:
        """Angle [rad] by which the tip trails the gripper along the path, as the tool leans; nothing turned by torque.

        A tool that leans ahead, aside or about itself is no reason to wait: it comes upright as it goes on.
        """
        lever = R_WT_des @ self.p_Ttip
        size = length(lever)
        if size < _LEAST_LEVER:
            return 0.0
        path = s.velocity - lever * float(lever @ s.velocity) / size**2  # pressing on is no way that a tip can trail
        speed = length(path)
        if speed < _LEAST_SPEED:
            return 0.0
        turn = R_WT_des @ (np.array(held) * so3_log(R_WT_des.T @ m.X_WT[:3, :3]))
        return -float(cross(turn, lever) @ path) / (size * speed)

    def release(self) -> None:
        super().release()
        self._tipping_gain, self._changes, self._friction = 1.0, [], 0.0
        self._asked.clear()
        self._turns.clear()
        self.normal.release()

    def _follows_surface(self, s: HybridSetpoint | None) -> TypeGuard[HybridSetpoint]:
        """Whether the set-point's directions follow the surface."""
        return s is not None and s.task_frame == "found" and self.parameters.law == "seed"

    def _task_axes(self, s: HybridSetpoint) -> tuple[Array, Array]:
        if not self._follows_surface(s):
            self.normal.release()
            return super()._task_axes(s)
        if not (self.contact.once or self.contact.anywhere):
            self.normal.release()
        self.normal.expect(s.R_W_task[:, 2])
        R_W_task = self.normal.axes(s.R_W_task)
        return R_W_task, R_W_task @ s.force_projector @ R_W_task.T

    def _observe(self, m: Measurement) -> tuple[int, ...]:
        made, normals = super()._observe(m), self.plan.normals
        if len(self.observers) != len(normals):
            self.observers = [SurfaceObserver(self.parameters) for _ in normals]
        for i, (n, observer) in enumerate(zip(normals, self.observers, strict=True)):
            if i in made:
                observer.start(m.stamp, n, m.tip, m.undeflected)
                if i == 0 and self._follows_surface(self.setpoint):
                    self.normal.start(m)
            if self.touches(i):
                if self._follows_surface(self.setpoint):
                    observer.tilt(self.normal.slope(behind=True), self.normal.share)
                observer.update(m.stamp, n, m.tip, m.undeflected, m.variance)
                if self._follows_surface(self.setpoint):
                    observer.lie(self.normal.height, n, m.undeflected)
        self._may_change()
        return made

    def _solve(self, s: HybridSetpoint, R_W_task: Array, P: Array, normals: Array) -> None:
        # fed-forward deflection has this gain in its loop: its time grows with it, so the loop's speed stays the same
        force_T = self.tool.R_WT.T @ (R_W_task @ s.wrench.force)
        stiffness = self.wrench_estimator.bushing.stiffness
        self._tipping_gain = tipping_gain(force_T, self.p_Ttip, s.torque_axes, stiffness)
        size = length(force_T)
        self._pressing_T = force_T / size if size > 0.0 else None
        # All of it would be an integrator, which hunts where a tip sticks and slips at the end of a soft grasp.
        moment = float(force_T @ self.p_Ttip)
        share = max(self.parameters.max_lean_share, _TRAILING * self._rough)
        self._upright = 1.0 - share * min(max(moment / min(stiffness.rotation), 0.0), 1.0)
        super()._solve(s, R_W_task, P, normals)
        wanted: list[float] = self.plan.wanted.tolist()
        if self._asked and len(self._asked[-1][1]) != len(wanted):
            self._asked.clear()
        if self.measured is not None and (not self._asked or self._asked[-1][1] != wanted):
            self._asked.append((self.measured.stamp, wanted))
        turn = self._to_come(s)
        if turn is not None:  # a tool that turns moves its tip along the force
            before = self.plan.lever
            lever = turn @ before
            self.plan = self.plan._replace(lever=lever, to_undeflected=self.plan.to_undeflected + lever - before)

    def _to_come(self, s: HybridSetpoint) -> Array | None:
        """Turn (3, 3) in W that the gripper was given, and no image shows yet; None where none counts.

        Along a surface that is found: of the wanted rotation. Elsewhere, in contact: of the deflection fed forward.
        """
        if self._follows_surface(s):
            return self.deflection.turned[1]
        if not (self._turns and self.contact.anywhere):
            return None
        newest = self._turns[-1][0]
        seen = next((q for stamp, q in reversed(self._turns) if stamp <= newest - self._loop_time), None)
        if seen is None:
            return None
        R_WT_des = s.X_W_tip[:3, :3] @ self._R_Ttip.T
        given = rotation_from_rpy(self._upright * self.deflection.q) @ rotation_from_rpy(seen).T
        return np.asarray(R_WT_des @ given @ R_WT_des.T)

    def _held(self, R_WT_des: Array) -> tuple[Array, Array]:
        """The tool is where and how it is wanted: the gripper leads by the slowly filtered deflection."""
        deflection = self.deflection
        return R_WT_des @ rotation_from_rpy(self._upright * deflection.q), deflection.tip_to_C - deflection.yielded

    def _steady(self, held: Vector3) -> Vector3:  # noqa: ARG002
        """Slowly: a roll that answers each turn of a blade about itself, a loop later, makes it stick and slip."""
        return as_vector3(self.deflection.steady)

    def _balanced(self, force: Array) -> Array:
        """Side forces are given way to; the grasp turns against them only where that takes little turning."""
        for side in self._sides():
            force = force - (1.0 - side.turning) * float(side.e @ force) * side.e
        return force

    def _yielding(self) -> Array | None:
        """(3, 3) in W, by which the gripper gives way to side deflections; None where none counts."""
        felt = self.parameters.side_stiffness
        sides = [side.stiffness / felt * np.outer(side.e, side.e) for side in self._sides()]
        return np.sum(sides, axis=0) if sides else None

    def _sides(self) -> list[Side]:
        """Where a force turns the tool as a wanted torque does: along axis x lever, for each torque axis in contact.

        A blade that sticks bears there what little its place is off by, times the grasp's stiffness, and that at the
        whole lever: a torque which no turning of a grasp that is soft in rotation can balance.
        """
        s, m = self.setpoint, self.measured
        if s is None or m is None or not any(s.torque_axes) or not self.contact.made:
            return []
        R_WT, bushing, out = m.X_WT[:3, :3], self.wrench_estimator.bushing, list[Side]()
        K = R_WT @ bushing.translation_stiffness(m.X_TC[:3, :3]) @ R_WT.T
        for i in np.flatnonzero(s.torque_axes):
            arm = np.cross(R_WT[:, i], R_WT @ self.p_Ttip)
            arm = arm - self.plan.normals.T @ (self.plan.normals @ arm)
            lever = length(arm)
            if lever > _LEAST_LEVER:
                e = arm / lever
                k, shift = bushing.stiffness.rotation[i], float(e @ K @ e)
                out.append(Side(e, shift, k**2 / (k**2 + (_TURNING * shift * lever**2) ** 2)))
        return out

    def _height_reference(self, s: HybridSetpoint, i: int) -> HeightReference:
        reference = super()._height_reference(s, i)
        if self.parameters.law == "plain" or i in self.contact.rests:
            return reference
        wanted = float(self.plan.wanted[i])
        needed = abs(wanted) / self.wrench_estimator.mean_stiffness  # [m] of deflection
        if not self.touches(i):  # the grasp must not deflect further within a loop than wanted
            return reference._replace(reach=_APPROACH_SHARE * needed)
        deflection = float(self.plan.normals[i] @ self.tool.R_WT @ self.plan.X_TC[:3, 3])
        if self._follows_surface(s):
            self.observers[i].tilt(self.normal.slope(behind=False), self.normal.share)
        offset, gradient, rate = self.observers[i].wanted_height(reference.normal, deflection, self._ahead)
        offset += dot(gradient, self._off_path)  # under the tip, wherever the path may be
        speed = max(reference.speed, min(s.press_speed or self.parameters.press_speed, needed / _PRESS_TIME))
        # a force may be taken back faster than it is built up: what rises under the tool must not press it
        pushes = (wanted > 0.0) - (wanted < 0.0)
        back = self.parameters.max_speed
        change = self._changes[i] if i < len(self._changes) else None
        quick = s.press_speed or min(_KNOWN * self.parameters.press_speed, back)
        known = HeightReference(
            reference.normal, offset, gradient, speed, inf, back, pushes, rate, deflection, change, quick
        )
        m, now = self.measured, self._relieved(i, reference.normal)
        if m is None or now is None:
            return known
        # A motion that has just been noticed may be any: nothing is pressed further for what is foretold of it.
        if pushes * (now - offset - dot(gradient, as_vector3(m.tip))) < 0.0:
            offset, gradient, rate = now, ZERO, 0.0
        return known._replace(offset=offset, gradient=gradient, rate=rate, speed=0.0)

    def _relieved(self, i: int, n: Vector3) -> float | None:
        """Height [m] of the undeflected tip that takes back what the newest image's force is above any wanted lately.

        An image shows what was wanted a loop time ago. None while the force is not above, beyond noise, or none is
        wanted.
        """
        m, wanted = self.measured, float(self.plan.wanted[i])
        if m is None or not wanted:
            return None
        asked = [w[i] for _, w in self._asked] or [wanted]
        wanted = max(asked) if wanted > 0.0 else min(asked)
        force, stiffness = dot(n, as_vector3(m.on_environment.force)), self.wrench_estimator.mean_stiffness
        over = abs(force) - abs(wanted) if force * wanted > 0.0 else 0.0
        if over <= max(_OVER * self.parameters.max_excess_force, _NOISE * stiffness * m.variance**0.5):
            return None
        return dot(n, as_vector3(m.undeflected)) - (over if wanted > 0.0 else -over) / stiffness


def tipping_gain(force_T: Array, p_Ttip: Array, torque_axes: AxisFlags, stiffness: Stiffness) -> float:
    """How many times further than the gripper a tool turns that is pressed with F at lever H: G = 1 / (1 - F H / k).

    On the axis that holds its angle the worst; where k < F H the tool tips (SP14). Turning about an axis moves only
    what lies across it, so the moment of that axis is F H less the force's and the lever's parts along it: nothing tips
    about the force's own axis.

    Args:
        force_T: (3,) [N] wanted of the tool on the environment, in T. p_Ttip: (3,) [m].
    """
    along: list[float] = (force_T * p_Ttip).tolist()
    moments = (sum(along) - a for a in along)  # positive where the tip is pressed away from T
    held = [m / k for m, k, on in zip(moments, stiffness.rotation, torque_axes, strict=True) if not on]
    return 1.0 / max(1.0 - max([0.0, *held]), _LEAST_MARGIN)
