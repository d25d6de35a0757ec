# SPDX-License-Identifier: Apache-2.0
"""The paper's law: Algorithm 2, hybrid by the partial inverses of Sec. V-C, and nothing more."""

from math import radians
from typing import NamedTuple

import numpy as np

from seed_control.algorithm2 import force_control
from seed_control.law.contact import ContactDetector, ForceShare, reached
from seed_control.law.directions import force_directions
from seed_control.law.partial_inverse import PartialInverseError, hybrid_force_position, hybrid_torque_orientation
from seed_control.law.tip_reference import HeightReference, TipReference
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.wrench.estimate import Measurement, WrenchEstimator
from seed_control.wrench.filters import ToolFilter
from seed_core.bushing import Model
from seed_core.spatial import (
    Array,
    Wrench,
    cross,
    length,
    make_pose,
    rotation_from_rpy,
    rpy_from_rotation,
    so3_exp,
    so3_log,
)
from seed_core.vector3 import ZERO, Vector3, as_vector3, dot

_FELT = 1.0  # [N] from which on a tip that has let go is pressed again


class Plan(NamedTuple):
    """What a set-point and the newest image settle until the next image; the defaults: nothing is followed.

    Attributes:
        R_W_task: (3, 3) axes of the task frame.
        normals: (m, 3) force directions in W, orthonormal. wanted: (m,) force along each of them [N].
        X_TC: (4, 4) wanted displacement of the grasp. X_WC: (4, 4) wanted pose of the gripper.
        lever: (3,) from T's origin to the tip; to_undeflected: (3,) from the wanted tip to where it were with the
            grasp undeflected, both in W [m].
        limits: names of the limits that shaped them.
    """

    R_W_task: Array = np.eye(3)
    normals: Array = np.zeros((0, 3))
    wanted: Array = np.zeros(0)
    X_TC: Array = np.eye(4)
    X_WC: Array = np.eye(4)
    lever: Array = np.zeros(3)
    to_undeflected: Array = np.zeros(3)
    limits: tuple[str, ...] = ()


class PublishedLaw:
    """Algorithm 2, hybrid by the partial inverses of Sec. V-C: kinematics of now, no gravity, no filter, the gripper on
    the path, and the stiffness map's model 'plain' (`seed_core/bushing.py`), which is not the law `plain`.

    For directions and axes that a set-point holds in position or angle, partial inverses stand in its line 5. Before
    contact angles are held, and the gripper goes along the force directions at approach speed.

    Attributes:
        setpoint: what is followed, or None.
        plan: what it comes to.
        measured: the newest image's measurement. tool: the same, as the law uses it.
        contact: `contact.made` while the tool touches.
        X_W_tip: (4, 4) measured pose of the tip, None before an image.
        trailing: as the state has it; None, for this law does not bring the tool upright.
        estimated_task, filtered_task: wrench of the tool on the environment about the tip, in the task frame.
        settled: in contact, with each force within a tenth (at least 0.3 N) of the wanted one.
    """

    synchronised = False  # kinematics of the image's moment, not of now
    gravity = False
    model: Model = "plain"
    smoothed = False  # low-pass of the tool's pose

    def __init__(self, parameters: ControllerParameters, wrench_estimator: WrenchEstimator) -> None:
        self.parameters, self.wrench_estimator = parameters, wrench_estimator
        self.p_Ttip, self._R_Ttip = wrench_estimator.p_Ttip, wrench_estimator.tool.X_Ttip[:3, :3]
        self.setpoint: HybridSetpoint | None = None
        self.plan = Plan()
        self.measured: Measurement | None = None
        self.tool = ToolFilter(parameters, self.p_Ttip, self.smoothed)
        self.contact = ContactDetector(parameters)
        self.reference = TipReference()
        self.X_W_tip: Array | None = None
        self.trailing: float | None = None
        self.estimated_task: Wrench | None = None
        self.filtered_task: Wrench | None = None
        self.settled = False

    def set_limits(self, parameters: ControllerParameters) -> None:
        """Use the limits of these parameters from now on."""
        self.parameters = parameters

    def adopt(self, setpoint: HybridSetpoint, p_WC: Vector3) -> None:
        """Follow a set-point from now on; p_WC is the commanded gripper position [m], for a start without a jump."""
        before, self.setpoint = self.setpoint, setpoint
        same = (
            before is not None
            and before.task_frame == setpoint.task_frame
            and np.array_equal(before.force_projector, setpoint.force_projector)
        )
        R_W_task, P = self._task_axes(setpoint)
        normals, going_on = force_directions(P, self.plan.normals if same else None, R_W_task)
        if not going_on:
            self.reference.undeflected = as_vector3(np.array(p_WC) + self.tool.R_WT @ self.p_Ttip)
            self.contact.reset()
        self.reference.lead(setpoint.X_W_tip, setpoint.velocity)
        self._solve(setpoint, R_W_task, P, normals)
        self._follow(setpoint, going_on)
        self._describe()

    def move(self, setpoint: HybridSetpoint) -> None:
        """Follow a set-point that differs from the present one in its place alone."""
        self.setpoint = setpoint
        self.reference.lead(setpoint.X_W_tip, setpoint.velocity)

    def release(self) -> None:
        """Follow nothing until the next `adopt`: all that a set-point has brought goes with it."""
        self.setpoint, self.plan, self.reference = None, Plan(), TipReference()
        self.contact.reset()
        self._describe()

    @property
    def regulates_force(self) -> bool:
        """Whether any direction carries force."""
        return len(self.plan.normals) > 0

    def image(self, m: Measurement, loop_time: float, age: float = 0.0) -> None:  # noqa: ARG002 (the full law does)
        """Take in a new image's measurement and renew what follows from it.

        Args:
            loop_time: [s] from the image to the arm's answer. age: [s] of the image.
        """
        self.measured = m
        self.reference.renew()
        self.tool.update(m)
        self.X_W_tip = m.X_WT @ self.wrench_estimator.tool.X_Ttip
        if self.setpoint is not None:
            R_W_task, P = self._task_axes(self.setpoint)
            normals, going_on = force_directions(P, self.plan.normals, R_W_task)
            if not going_on:
                self.contact.reset()
            self._solve(self.setpoint, R_W_task, P, normals)
            self._observe(m)
            self._follow(self.setpoint)
        self._describe()

    def _observe(self, m: Measurement) -> tuple[int, ...]:
        """Look for contact; the force directions along which this very image has made it."""
        deviation = self.wrench_estimator.mean_stiffness * m.variance**0.5
        known = self.setpoint is not None and self.setpoint.touches
        return self.contact.update(self.plan.normals @ m.on_environment.force, self.plan.wanted, deviation, known)

    def shares(self) -> list[ForceShare]:
        """How much of the wanted force there is, by the force directions along which there is one."""
        force, wanted = self.tool.on_environment.force, self.plan.wanted.tolist()
        along = self.plan.normals @ force
        squares = (float(force @ force) - along**2).tolist()  # [N^2] across each
        of_each = enumerate(zip(along.tolist(), wanted, self._compliances(), squares, strict=True))
        return [
            ForceShare(
                f / w, reached(f, w), abs(w) * compliance, max(square, 0.0) ** 0.5 / abs(w), touches=self.touches(i)
            )
            for i, (f, w, compliance, square) in of_each
            if w
        ]

    def _compliances(self) -> list[float]:
        """Of the grasp along each force direction [m/N]."""
        m, N = self.measured, self.plan.normals
        if m is None or not len(N):
            return [0.0] * len(N)
        K = self.wrench_estimator.bushing.translation_stiffness(m.X_TC[:3, :3])
        in_T = m.X_WT[:3, :3].T @ N.T
        return np.sum(in_T * np.linalg.solve(K, in_T), axis=0).tolist()  # type: ignore[no-any-return]

    def touches(self, i: int) -> bool:
        """Whether the tool touches along force direction i."""
        touching = self.contact.touching
        return i < len(touching) and touching[i]

    def _describe(self) -> None:
        """What the state shows, whenever an image or a set-point changes it."""
        m, filtered, plan = self.measured, self.tool.on_environment, self.plan
        if m is None:
            return
        self.estimated_task = m.on_environment.rotated(plan.R_W_task.T)
        self.filtered_task = filtered.rotated(plan.R_W_task.T)
        pairs = zip((plan.normals @ filtered.force).tolist(), plan.wanted.tolist(), strict=True)
        self.settled = self.contact.made and all(reached(f, wanted) for f, wanted in pairs)

    def regulated_error(self) -> Wrench | None:
        """Filtered estimate less wanted wrench, where force and torque are regulated, in the task frame.

        None while no set-point is followed.
        """
        s, m = self.setpoint, self.measured
        if s is None or m is None or self.filtered_task is None:
            return None
        off = self.filtered_task.minus(s.wrench)
        axes = self.plan.R_W_task.T @ m.X_WT[:3, :3]  # T's, in the task frame
        about = axes @ np.diag(np.array(s.torque_axes, dtype=float)) @ axes.T
        return Wrench(about @ off.torque, s.force_projector @ off.force)

    def _task_axes(self, s: HybridSetpoint) -> tuple[Array, Array]:
        """Axes R_W_task (3, 3) of the task frame, and the projector P (3, 3) onto the force directions, in W."""
        R_W_task = self.tool.R_WT @ self._R_Ttip if s.task_frame == "tool" else s.R_W_task
        return R_W_task, R_W_task @ s.force_projector @ R_W_task.T

    def _solve(self, s: HybridSetpoint, R_W_task: Array, P: Array, normals: Array) -> None:
        """Algorithm 2 from the set-point and the newest image."""
        R_WT, limits = self.tool.R_WT, list[str]()
        force, measured = R_W_task @ s.wrench.force, self._balanced(self.tool.on_environment.force)
        load = Wrench(R_W_task @ s.wrench.torque, P @ force + measured - P @ measured)  # off P as measured
        R_WT_des = s.X_W_tip[:3, :3] @ self._R_Ttip.T
        R_WC_held, tip_to_C = self._held(R_WT_des)
        discrepancy = self.tool.discrepancy

        def partial_inverse(wrench_T: Wrench) -> Array:
            spring = wrench_T.minus(self.wrench_estimator.weight(R_WT))
            if discrepancy is not None:  # what the bushing must give for the model's spring to give the wanted load
                spring = spring.plus(discrepancy)
            R_TC = R_WT.T @ R_WC_held
            if any(s.torque_axes) and self.contact.made:
                R_TC = self._torque_orientation(s, spring.torque, R_TC, R_WT.T @ R_WT_des, limits)
            return make_pose(R_TC, self._force_position(R_WT.T @ P @ R_WT, spring.force, R_TC, limits))

        X_TC, X_WC = force_control(load, self.tool.X_WT, self.p_Ttip, partial_inverse)
        lever = R_WT @ self.p_Ttip
        self.plan = Plan(R_W_task, normals, normals @ force, X_TC, X_WC, lever, tip_to_C + lever, tuple(limits))

    def _balanced(self, force: Array) -> Array:
        """Of the tool's measured force on the environment (3,) [N] in W, what the wanted displacement balances."""
        return force

    def _held(self, R_WT_des: Array) -> tuple[Array, Array]:
        """What is held in angle and position: R_WC (3, 3), and from the wanted tip to C in W (3,) [m].

        Here the gripper is, as if the grasp were not deflected.
        """
        return R_WT_des, -(R_WT_des @ self.p_Ttip)

    def _torque_orientation(
        self, s: HybridSetpoint, torque: Array, R_TC_held: Array, R_TT_des: Array, limits: list[str]
    ) -> Array:
        """Wanted R_TC (3, 3), for the spring's torque (3,) [N m] in T or the held angle about each axis."""
        if self.model == "midpoint":  # less what its force makes about T's origin
            torque = torque - 0.5 * cross(self.tool.p_TC, self.tool.spring.force)
        held = as_vector3(rpy_from_rotation(R_TC_held))
        k = self.wrench_estimator.bushing.stiffness.rotation
        try:
            wanted = hybrid_torque_orientation(k, as_vector3(torque), self._steady(held), s.torque_axes, held[1])
        except PartialInverseError:
            limits.append("torque domain")
            return R_TC_held
        bound = radians(self.parameters.max_rotation)
        wanted = as_vector3(np.where(s.torque_axes, wanted, held))
        clipped = tuple(min(max(angle, -bound), bound) for angle in wanted)
        if clipped != wanted:
            limits.append("max_rotation")
        R_TC = rotation_from_rpy(clipped)
        drift = so3_log(R_TT_des.T @ R_TC)
        size, bound = length(drift), bound + radians(self.parameters.max_drift)
        if size <= bound:
            return R_TC
        limits.append("max_drift")
        return R_TT_des @ so3_exp(drift * (bound / size))

    def _steady(self, held: Vector3) -> Vector3:
        """The angles (rpy of R_TC) at which the angles that torques turn are computed; here those that are held."""
        return held

    def _force_position(self, P: Array, force: Array, R_TC: Array, limits: list[str]) -> Array:
        """Wanted p_TC (3,) [m], for the spring's force (3,) [N] along P (3, 3), all in T; as measured elsewhere."""
        K = self.wrench_estimator.bushing.translation_stiffness(R_TC)
        d = hybrid_force_position(P, K, self.tool.p_TC, force)
        size, bound = length(d), self.parameters.max_deflection
        if size <= bound:
            return d
        limits.append("max_deflection")
        return d * (bound / size)

    def _follow(self, s: HybridSetpoint, changed: bool = False) -> None:
        """What the reference moves along until the next image; changed: the set-point is new, the image is not."""
        references = [self._height_reference(s, i) for i in range(len(self.plan.normals))]
        follow = self.reference.change if changed else self.reference.follow
        follow(references, as_vector3(self.plan.lever), as_vector3(self.plan.to_undeflected))

    def _height_reference(self, s: HybridSetpoint, i: int) -> HeightReference:
        """Along force direction i to where Algorithm 2 wants the gripper; along the path where nothing is wanted."""
        plan, speed = self.plan, s.approach_speed or self.parameters.approach_speed
        n = as_vector3(plan.normals[i])
        if plan.wanted[i] == 0.0 and not self.touches(i):
            return HeightReference(n, float(plan.normals[i] @ plan.to_undeflected), n, speed)
        rests = self._rest(i, n)
        height = float(plan.normals[i] @ (plan.X_WC[:3, 3] + plan.lever)) if rests is None else rests
        return HeightReference(n, height, ZERO, speed)

    def _rest(self, i: int, n: Vector3) -> float | None:
        """Height [m] at which a tip stays that has let go, where no force is wanted at all; None elsewhere.

        A force of zero does not show whether the surface is still there: what is followed on would drift away.
        """
        force = abs(dot(n, as_vector3(self.tool.on_environment.force)))
        if self.plan.wanted.any() or not self.touches(i) or force > _FELT:
            self.contact.rests.pop(i, None)
        elif reached(force, 0.0):
            self.contact.rests.setdefault(i, dot(n, self.reference.undeflected))
        return self.contact.rests.get(i)
