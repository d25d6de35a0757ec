# SPDX-License-Identifier: Apache-2.0
"""The simulated cell in time: an arm that moves the gripper, Drake's bushing, a tool and a tilted table.

LinearBushingRollPitchYaw acts with frame A = T and frame C = C, the convention of `seed_core.bushing`.
"""

from __future__ import annotations

from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.errors import FailedError, SeedError
from seed_core.gripper import GripperPressure
from seed_core.hand import weight_about_T
from seed_core.spatial import Array, Wrench, cross, inverse_pose, make_pose, rotation_from_rpy, so3_exp, so3_log
from seed_sim.plant.arm import Arm
from seed_sim.plant.cell import Cell, Surface
from seed_sim.plant.tools import damping_of, fastest_rate, inertia_of, shape_of
from seed_sim.scenario import Scenario

DT = 1e-3  # [s] of a plant step
_MOST_SUBSTEPS = 10
_FRAME = 0.1  # [s] between pictures of a replay


class PlantError(SeedError):
    """A plant that cannot be simulated."""


def draw_surface(scenario: Scenario, X_W_work: Array, rng: np.random.Generator, points: int) -> Surface:
    """The table of one seed: tilted about the work frame's axes, and off in height."""
    table = scenario.table
    tilt = np.deg2rad([rng.uniform(*table.tilt_x), rng.uniform(*table.tilt_y), 0.0])
    X = make_pose(rotation_from_rpy(tilt), (0.0, 0.0, 1e-3 * rng.uniform(*table.height)))
    total = table.total_stiffness
    stiffness = total / points if total is not None else table.contact_stiffness
    return Surface(X_W_work @ X, table.friction, stiffness)


class Plant:
    """One cell. `command` a flange pose, `advance` in time, read poses and loads; all frames as in the notation.

    Args:
        scenario: what is simulated.
        seed: draws the table and the arm's errors.
        X_W_work: (4, 4) frame of the nominal table's place of work.
        X_WE: (4, 4) flange pose at the start.
        welded: the tool is bolted to the gripper (the baseline).
        meshcat: a pydrake.geometry.Meshcat to draw in, or None.
    """

    def __init__(
        self, scenario: Scenario, seed: int, X_W_work: Array, X_WE: Array, *, welded: bool = False, meshcat: Any = None
    ) -> None:
        self.scenario, self.welded = scenario, welded
        self.hand, self.tool = scenario.hand, scenario.tool
        self.shape = shape_of(scenario.tool_kind, scenario.tool)
        rng = np.random.default_rng([seed, 1])
        touching = 4 if scenario.tool_kind == "peg" else len(self.shape.points)
        self.surface = draw_surface(scenario, X_W_work, rng, touching)
        self.arm = Arm(scenario.servo, X_WE, rng)
        self._grip = 1.0  # stiffness of the grip relative to its nominal width
        self.width = scenario.grasp.nominal_width
        self._X_EC, self._p_Ttip = self.hand.X_EC, self.tool.X_Ttip[:3, 3]
        self._inertia = None if welded else self._tool_inertia()
        self._substeps = self._check_numerics()
        self._meshcat = meshcat
        self._build()
        self._X_WC: Array = X_WE @ self._X_EC
        self._X_WT: Array | None = None
        self._at_rest: Array = np.array(self._cell.plant.GetPositionsAndVelocities(self._cell.context))  # as built
        self._state = self._felt = self._at_rest  # now, and when the last step's contact forces arose
        self.reset(X_WE)

    # --- running -----------------------------------------------------------------------------------------------
    @property
    def time(self) -> float:
        """[s]"""
        return self._steps * DT

    def command(self, X_WE: Array) -> None:
        """Send the arm to X_WE (4, 4)."""
        self.arm.command(self.time, X_WE)

    def advance(self, t: float) -> None:
        """Simulate until time t [s]."""
        end = self._steps
        while end * DT < t - 1e-9:
            end += 1
        # The arm feels no load, so it moves first: to alternate with Drake would cost the processor's caches.
        motions = []
        for n in range(self._steps, end):
            self.arm.advance(n * DT + DT, DT)
            motions.append(self._follow_arm(self.arm.turned))
        self._simulate(motions)

    def drive(self, X_WE: Array, t: float) -> None:
        """Simulate until t [s] with the flange moved evenly from where it is to X_WE, by an arm outside."""
        n = max(round((t - self.time) / DT), 1)
        X0 = self.arm.reported
        turn, p0 = so3_log(X0[:3, :3].T @ X_WE[:3, :3]), X0[:3, 3]
        motions = []
        for i in range(1, n + 1):
            self.arm.reported = make_pose(X0[:3, :3] @ so3_exp(i / n * turn), p0 + i / n * (X_WE[:3, 3] - p0))
            motions.append(self._follow_arm(None))
        self._simulate(motions)

    def _follow_arm(self, turned: Array | None) -> Array:
        """The gripper goes to where the arm is, from the pose and with the velocity (13,) that Drake gets."""
        before, after = self._X_WC, self.arm.actual @ self._X_EC
        if turned is None:
            turned = so3_log(after[:3, :3] @ before[:3, :3].T)
        self._X_WC = after
        return _pose_and_velocity(before, (after[:3, 3] - before[:3, 3]) / DT, turned / DT)

    def _simulate(self, motions: list[Array]) -> None:
        """One step of the plant for each motion of the gripper."""
        context, drake, state = self._cell.context, self._cell.plant, self._state
        for motion in motions:
            self._place_gripper(state, motion)
            for _ in range(self._substeps):
                context.SetDiscreteState(state)
                self._felt = state
                state = np.array(drake.EvalUniquePeriodicDiscreteUpdate(context).get_vector(0).value())
            self._steps += 1
            if self._meshcat is not None and self.time >= self._drawn + _FRAME:
                self._state = state
                self._publish()
        self._state, self._X_WT = state, None
        if not np.isfinite(state).all():
            raise FailedError(f"the simulation of scenario '{self.scenario.name}' diverged before {self.time:.3f} s")

    def _place_gripper(self, state: Array, motion: Array) -> None:
        """Write pose and velocity (13,) of the gripper into the state."""
        q, v = self._cell.gripper_at
        state[q : q + 7] = motion[:7]
        state[v : v + 6] = motion[7:]

    def reset(self, X_WE: Array | None = None) -> None:
        """Everything as it was built, at time 0: fingers and screw too; the arm at X_WE (default: where it is)."""
        if X_WE is not None:
            self.arm.reset(X_WE)
        self._steps, self._drawn = 0, -np.inf
        self._X_WC = self.arm.actual @ self._X_EC
        self._state = self._at_rest.copy()
        self.set_gripper_width(self.scenario.grasp.nominal_width)
        self._place_gripper(self._state, _pose_and_velocity(self._X_WC, np.zeros(3), np.zeros(3)))
        self.grasp()
        if self._meshcat is not None:
            self._publish()

    def grasp(self, p_CT: Array | None = None) -> None:
        """Take the tool anew: T coincides with C, or lies at p_CT (3,) [m] in it, and rests relative to it."""
        self._X_WT = None
        if not self.welded:
            q, v = self._cell.tool_at
            R, p = self._X_WC[:3, :3], self._X_WC[:3, 3]
            self._state[q : q + 4] = _quaternion_wxyz(R)
            self._state[q + 4 : q + 7] = p if p_CT is None else p + R @ p_CT
            self._state[v : v + 6] = 0.0
        self._cell.context.SetDiscreteState(self._state)
        self._felt = self._state

    def _publish(self) -> None:
        self._drawn = self.time
        self._cell.root.SetTime(self.time)
        self._cell.context.SetDiscreteState(self._state)
        self._cell.diagram.ForcedPublish(self._cell.root)
        self._cell.context.SetDiscreteState(self._felt)

    # --- what can be read --------------------------------------------------------------------------------------
    @property
    def X_WE(self) -> Array:
        """Flange pose as the arm reports it (4, 4); the repeatability error is not in it."""
        return self.arm.reported

    @property
    def X_WC(self) -> Array:
        """True pose of the gripper's frame C (4, 4)."""
        return self._X_WC

    @property
    def X_WT(self) -> Array:
        """True pose of the tool (4, 4)."""
        if self.welded:
            return self._X_WC
        if self._X_WT is None:
            q = self._cell.tool_at[0]
            self._X_WT = make_pose(_rotation_of(self._state[q : q + 4]), self._state[q + 4 : q + 7])
        return self._X_WT

    @property
    def X_CT(self) -> Array:
        """True displacement of the tool in the grasp (4, 4)."""
        return inverse_pose(self._X_WC) @ self.X_WT

    @property
    def contact_wrench(self) -> Wrench:
        """What the tool does to the environment about its tip, written in the world [N m, N], over the last step."""
        on_tool = self._cell.contact_forces.Eval(self._cell.context)  # about T's origin (C's when welded), in the world
        lever = self.X_WT[:3, :3] @ self._p_Ttip
        force = -on_tool[3:]
        return Wrench(-on_tool[:3] - cross(lever, force), force)

    @property
    def bushing_wrench(self) -> Wrench:
        """The spring's and damper's load on the tool about T, in T; zero when welded."""
        if self.welded:
            return Wrench.zero()
        self._cell.context.SetDiscreteState(self._state)
        F = self._cell.bushing.CalcBushingSpatialForceOnFrameA(self._cell.context)
        self._cell.context.SetDiscreteState(self._felt)  # where contact_wrench is to be read
        return Wrench(np.asarray(F.rotational()), np.asarray(F.translational()))

    @property
    def ft_wrench(self) -> Wrench:
        """What a six-axis sensor between flange and gripper reads of the tool: load on the flange about E, in E.

        The gripper's own weight is tared. Of a welded tool it reads contact and weight.
        """
        X_ET = inverse_pose(self.arm.actual) @ self.X_WT
        on_gripper = self._static_load() if self.welded else Wrench.zero().minus(self.bushing_wrench)
        return on_gripper.about(-X_ET[:3, :3].T @ X_ET[:3, 3]).rotated(X_ET[:3, :3])

    def _static_load(self) -> Wrench:
        """Contact and weight of a welded tool, on the gripper, about T in T."""
        R_TW = self.X_WT[:3, :3].T
        contact = Wrench.zero().minus(self.contact_wrench).rotated(R_TW).about(-self._p_Ttip)
        return contact.plus(weight_about_T(self._true_mass, self.tool.center_of_mass, R_TW.T))

    @property
    def pressure(self) -> float:
        """In the bubbles [hPa]."""
        g = self.scenario.grasp
        return GripperPressure(g.nominal_width, g.nominal_pressure, g.pressure_slope).at_width(self.width)

    def set_gripper_width(self, width: float) -> None:
        """Close to width [m]: a firmer grip is a stiffer one (Sec. VI of the paper).

        Raises:
            PlantError: the stiffness would leave 0.3 to 4 times the nominal one, or cannot be integrated.
        """
        g = self.scenario.grasp
        grip = 1.0 + g.stiffening * (g.nominal_width - width)
        if not 0.3 <= grip <= 4.0:
            raise PlantError(
                f"gripper width = {width:.4f} m would make the grip {grip:.2f} times as stiff; 0.3 to 4 "
                "times is possible"
            )
        if self._inertia is not None:
            self._stiffen(g.stiffness.scaled(grip))
        self.width, self._grip = width, grip

    def _stiffen(self, stiffness: Stiffness) -> None:
        assert self._inertia is not None
        ratio = self.scenario.grasp.damping_ratio
        rate = fastest_rate(self._inertia, stiffness, ratio) * DT / self._substeps
        if rate >= 0.95:
            raise PlantError(
                f"so firm a grip cannot be integrated with this tool (rate x step = {rate:.2f}, below "
                "0.95 is needed): close less"
            )
        damping = damping_of(self._inertia, stiffness, ratio)
        bushing, context = self._cell.bushing, self._cell.context
        bushing.SetTorqueStiffnessConstants(context, np.array(stiffness.rotation))
        bushing.SetForceStiffnessConstants(context, np.array(stiffness.translation))
        bushing.SetTorqueDampingConstants(context, damping[0])
        bushing.SetForceDampingConstants(context, damping[1])

    @property
    def stiffness(self) -> Stiffness:
        """Of the plant at the present width."""
        return self.scenario.grasp.stiffness.scaled(self._grip)

    # --- building ----------------------------------------------------------------------------------------------
    @property
    def _true_mass(self) -> float:
        mass = self.scenario.true_mass
        return self.tool.mass if mass is None else mass

    def _tool_inertia(self) -> Any:
        g = self.scenario.grasp
        if self._true_mass + g.pad_mass <= 0.0:
            raise PlantError("a tool without mass cannot be simulated: give the tool a mass or the grasp a pad_mass")
        com = np.array(self.tool.center_of_mass)
        return inertia_of(self.shape, self._true_mass, com, g.pad_mass, g.pad_radius)

    def _check_numerics(self) -> int:
        """Parts that a step is cut into: the bushing is integrated explicitly, stable only while rate x step < 1."""
        if self._inertia is None:
            return 1
        g = self.scenario.grasp
        rate = fastest_rate(self._inertia, g.stiffness, g.damping_ratio)
        parts = max(ceil(rate * DT / 0.5), 1)
        if parts > _MOST_SUBSTEPS:
            raise PlantError(
                f"scenario '{self.scenario.name}': the grasp's fastest mode, {rate:.0f} rad/s, would need {parts} "
                f"sub-steps of a millisecond, at most {_MOST_SUBSTEPS} are taken: give the tool the inertia of the "
                "gripper pads (grasp.pad_mass, grasp.pad_radius), or less stiffness or damping"
            )
        return parts

    def _build(self) -> None:
        g = self.scenario.grasp
        none = (np.zeros(3), np.zeros(3))
        damping = damping_of(self._inertia, g.stiffness, g.damping_ratio) if self._inertia is not None else none
        self._cell = Cell(
            self.scenario, self.surface, self.shape, self._inertia, damping, DT / self._substeps, self._meshcat
        )


def _pose_and_velocity(X_WC: Array, velocity: Array, angular_velocity: Array) -> Array:
    """(13,) quaternion w, x, y, z, position, angular velocity and velocity in the world, as Drake orders them."""
    return np.array(
        (*_quaternion_wxyz(X_WC[:3, :3]), *X_WC[:3, 3].tolist(), *angular_velocity.tolist(), *velocity.tolist())
    )


def _quaternion_wxyz(R: Array) -> tuple[float, float, float, float]:
    """Unit quaternion w, x, y, z of R, by its largest component (Shepperd)."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    parts = (1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i)
    largest = parts.index(max(parts))
    s = 0.5 / sqrt(parts[largest])
    if largest == 0:
        return s * parts[0], s * (h - f), s * (c - g), s * (d - b)
    if largest == 1:
        return s * (h - f), s * parts[1], s * (d + b), s * (g + c)
    if largest == 2:
        return s * (c - g), s * (d + b), s * parts[2], s * (h + f)
    return s * (d - b), s * (g + c), s * (h + f), s * parts[3]


def _rotation_of(q: Array) -> Array:
    """R (3, 3) of a quaternion w, x, y, z, whatever its norm."""
    w, x, y, z = q.tolist()
    n = 2.0 / (w * w + x * x + y * y + z * z)
    return np.array(
        (
            (1.0 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y)),
            (n * (x * y + w * z), 1.0 - n * (x * x + z * z), n * (y * z - w * x)),
            (n * (x * z - w * y), n * (y * z + w * x), 1.0 - n * (x * x + y * y)),
        )
    )


def save_replay(meshcat: Any, path: Path) -> None:
    """Write Meshcat's scene and recording as one standalone page."""
    path.write_text(meshcat.StaticHtml(), encoding="utf-8")
