# SPDX-License-Identifier: Apache-2.0
"""The simulated cell in time: an arm that moves the gripper, Drake's bushing, a tool and a tilted table.

LinearBushingRollPitchYaw acts with frame A = T and frame C = C, the convention of `seed_core.bushing`. Another grasp
takes its place as a `GraspForce`, which is asked at every (sub-)step.
"""

import numpy as np

from seed_core.arm.quaternion import as_quaternion
from seed_core.bushing import Stiffness
from seed_core.errors import FailedError
from seed_core.hand import weight_about_T
from seed_core.spatial import Array, Wrench, cross, inverse_pose, make_pose, so3_exp, so3_log
from seed_sim.membrane.hold import MembraneHold
from seed_sim.plant.arm import Arm
from seed_sim.plant.grasp_force import GraspForce, pose_in, relative
from seed_sim.plant.grip import Grip, PlantError
from seed_sim.plant.holes.contact import SUBSTEPS, HoleContact
from seed_sim.plant.membrane_grip import MembraneGrip
from seed_sim.plant.table import draw_surface
from seed_sim.plant.tools import ContactShape, ToolInertia, inertia_of, shape_of
from seed_sim.replay.film import Film
from seed_sim.scenario import Scenario

DT = 1e-3  # [s] of a plant step
_ZERO = np.zeros(3)


class Plant:
    """One cell. `command` a flange pose, `advance` in time, read poses and loads; all frames as in the notation.

    Args:
        scenario: the simulated cell.
        seed: draws the table and the arm's errors.
        X_W_work: (4, 4) frame of the nominal table's place of work.
        X_WE: (4, 4) flange pose at the start.
        welded: the tool is bolted to the gripper (the baseline).
        film: what keeps moments of it to look at, or None.
        grasp_force: what the grasp does to the tool, with its damping; None: what the scenario's `grasp.kind` says.

    Attributes:
        grip: what holds the tool, and how firmly.

    Raises:
        PlantError: no step is small enough for the tool in this grasp.
        MembraneError: the scenario's membranes cannot be inflated, or the tool pierces them.
        FailedError: Drake is not installed.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        X_W_work: Array,
        X_WE: Array,
        *,
        welded: bool = False,
        film: Film | None = None,
        grasp_force: GraspForce | None = None,
    ) -> None:
        try:
            from seed_sim.plant.cell import Cell
        except ImportError as error:
            raise FailedError("the simulated cell needs Drake: pip install drake==1.51.1") from error
        self.scenario, self.welded = scenario, welded
        self.hand, self.tool = scenario.hand, scenario.tool
        shape = shape_of(scenario.tool_kind, scenario.tool, scenario.blade_width)
        rng = np.random.default_rng([seed, 1])
        self.surface = draw_surface(scenario.table, X_W_work, rng, shape.touching, seed)
        self.hole = None  # what the tool is put into, if the scenario has one
        if scenario.hole is not None:
            if self.surface.shapes:
                raise PlantError(f"scenario '{scenario.name}': a hole needs a flat table: leave out table.surface")
            self.hole = HoleContact(
                scenario.hole, scenario.tool.X_Ttip, self.surface.X_WS, np.random.default_rng([seed, 5])
            )
        self.arm = Arm(scenario.servo, X_WE, rng)
        self._com = np.array(scenario.tool.center_of_mass)
        inertia = None if welded else self._tool_inertia(shape)
        self.grip: Grip | MembraneGrip
        bushing = None
        if scenario.grasp.kind == "membrane" and inertia is not None and grasp_force is None:
            self.grip = grasp_force = MembraneGrip(scenario, inertia, DT)
        else:
            self.grip = grip = Grip(scenario.grasp, inertia, DT, scenario.name)
            bushing = grip if grasp_force is None else None
        self._substeps = self.grip.substeps if self.hole is None else max(self.grip.substeps, SUBSTEPS)
        self._film, self._grasp_force = film, None if welded else grasp_force
        self._cell = Cell(scenario, self.surface, shape, inertia, bushing, DT / self._substeps)
        self._X_EC, self._p_Ttip = self.hand.X_EC, self.tool.X_Ttip[:3, 3]
        self._X_WC: Array = X_WE @ self._X_EC
        self._X_WT: Array | None = None  # until it is asked for
        self._initial: Array = np.array(self._cell.plant.GetPositionsAndVelocities(self._cell.context))
        self._state = self._before = self._initial  # now, and before the last step: there contact forces are read
        self.reset(X_WE)

    def _tool_inertia(self, shape: ContactShape) -> ToolInertia:
        g, mass = self.scenario.grasp, self.scenario.tool_mass
        if mass + g.pad_mass <= 0.0:
            raise PlantError("a tool without mass cannot be simulated: give the tool a mass or the grasp a pad_mass")
        return inertia_of(shape, mass, self._com, g.pad_mass, g.pad_radius)

    @property
    def time(self) -> float:
        """[s]"""
        return self._steps * DT

    def command(self, X_WE: Array) -> None:
        """Send the arm to X_WE (4, 4). Raises FailedError where that is not finite."""
        self._check(X_WE)
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
            motions.append(self._follow_arm(self.arm.rotation_step))
        self._simulate(motions)

    def drive(self, X_WE: Array, t: float) -> None:
        """Simulate until t [s] with the flange moved evenly from where it is to X_WE, by an arm outside.

        Raises:
            FailedError: X_WE is not finite.
        """
        self._check(X_WE)
        n = max(round((t - self.time) / DT), 1)
        X0 = self.arm.reported
        turn, p0 = so3_log(X0[:3, :3].T @ X_WE[:3, :3]), X0[:3, 3]
        motions = []
        for i in range(1, n + 1):
            self.arm.wander((self._steps + i) * DT)
            self.arm.reported = make_pose(X0[:3, :3] @ so3_exp(i / n * turn), p0 + i / n * (X_WE[:3, 3] - p0))
            motions.append(self._follow_arm(None))
        self._simulate(motions)

    def _check(self, X_WE: Array) -> None:
        if not np.isfinite(X_WE).all():
            raise FailedError(
                f"scenario '{self.scenario.name}': at {self.time:.3f} s the arm is sent to a pose that is not finite"
            )

    def _follow_arm(self, rotation: Array | None) -> Array:
        """The gripper goes to where the arm is, from the pose and with the velocity (13,) that Drake gets.

        rotation: vector (3,) [rad] of this step in the world, if it is known.
        """
        before, after = self._X_WC, self.arm.actual @ self._X_EC
        if rotation is None:
            rotation = so3_log(after[:3, :3] @ before[:3, :3].T)
        self._X_WC = after
        return _pose_and_velocity(before, rotation / DT, (after[:3, 3] - before[:3, 3]) / DT)

    def _simulate(self, motions: list[Array]) -> None:
        """One step of the plant for each motion of the gripper."""
        context, drake, state = self._cell.context, self._cell.plant, self._state
        parts = self._substeps
        for motion in motions:
            self._place_gripper(state, motion)
            if self._cell.patches is not None:
                self._place_table(state)
            for i in range(parts):
                context.SetDiscreteState(state)
                if self._grasp_force is not None or self.hole is not None:
                    self._cell.apply(*self._from_outside(state, (self._steps + i / parts) * DT))
                self._before = state
                state = np.array(drake.EvalUniquePeriodicDiscreteUpdate(context).get_vector(0).value())
            self._steps += 1
        self._state, self._X_WT = state, None
        if not np.isfinite(state).all():
            raise FailedError(f"the simulation of scenario '{self.scenario.name}' diverged before {self.time:.3f} s")
        if self._film is not None:
            self._film.look(self)

    def _from_outside(self, state: Array, t: float) -> tuple[Array, Array]:
        """What loads the tool besides Drake's own: torque about T's origin and force, in the world (3,) [N m], [N]."""
        torque, force = _ZERO, _ZERO
        if self._grasp_force is not None:
            to_C = relative(state, self._cell.tool_at, self._cell.gripper_at)
            load = self._grasp_force.wrench(to_C.X_TC, to_C.V_TC, t)
            torque, force = to_C.R_WT @ load.torque, to_C.R_WT @ load.force
        if self.hole is not None:
            q, v = self._cell.tool_at
            of_hole = self.hole.update(pose_in(state, q), state[v : v + 6], DT / self._substeps)
            torque, force = torque + of_hole.torque, force + of_hole.force
        return torque, force

    def _place_gripper(self, state: Array, motion: Array) -> None:
        """Write pose and velocity (13,) of the gripper into the state."""
        q, v = self._cell.gripper_at
        state[q : q + 7] = motion[:7]
        state[v : v + 6] = motion[7:]

    def _place_table(self, state: Array) -> None:
        """Write what the tool slides over into the state, next to where the tool is."""
        assert self._cell.patches is not None
        self._cell.patches.place(state, self._centres(pose_in(state, self._cell.tool_at[0])), self.time)

    def _centres(self, X_WT: Array) -> Array:
        """Of the spheres that touch, (n, 3) [m] in W."""
        return np.asarray(self._cell.centres @ X_WT[:3, :3].T + X_WT[:3, 3])

    @property
    def true_normal(self) -> Array:
        """(3,) in W: the surface's where the tool is nearest to it."""
        touches = [self.surface.nearest(c, self.time) for c in self._centres(self.X_WT)]
        return min(touches, key=lambda touch: touch.distance).normal

    def reset(self, X_WE: Array) -> None:
        """Everything as it was built, at time 0: fingers, screw and hole too, nothing carries the tool; X_WE (4, 4)."""
        self.arm.reset(X_WE)
        self.carry(0.0)
        self._steps = 0
        self._X_WC = self.arm.actual @ self._X_EC
        self._state = self._initial.copy()
        self.set_gripper_width(self.scenario.grasp.nominal_width)
        self._place_gripper(self._state, _pose_and_velocity(self._X_WC, _ZERO, _ZERO))
        if self.hole is not None:
            self.hole.reset()
        self.grasp()
        if self._cell.patches is not None:
            self._place_table(self._state)
            self._cell.context.SetDiscreteState(self._state)
        if self._film is not None:
            self._film.look(self)

    def grasp(self, p_CT: Array = _ZERO) -> None:
        """Take the tool anew: T coincides with C, or lies at p_CT (3,) [m] in it, and rests relative to it."""
        self._X_WT = None
        if self._grasp_force is not None:
            self._grasp_force.reset(self.time)
        if self.hole is not None:
            self.hole.part()
        self._cell.apply(_ZERO, _ZERO)
        if not self.welded:
            q, v = self._cell.tool_at
            X_WT = self._X_WC @ make_pose(None, p_CT)
            self._state[q : q + 7] = _pose_and_velocity(X_WT, _ZERO, _ZERO)[:7]
            self._state[v : v + 6] = 0.0
        self._cell.context.SetDiscreteState(self._state)
        self._before = self._state

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
            self._X_WT = pose_in(self._state, self._cell.tool_at[0])
        return self._X_WT

    @property
    def X_CT(self) -> Array:
        """True displacement of the tool in the grasp (4, 4)."""
        return inverse_pose(self._X_WC) @ self.X_WT

    @property
    def contact_wrench(self) -> Wrench:
        """Load of the tool on the environment about its tip, written in the world [N m, N], over the last step."""
        if self.hole is not None:
            on_tool = np.concatenate(self.hole.load)
        else:  # about T's origin (C's when welded), in the world
            on_tool = self._cell.contact_forces.Eval(self._cell.context)
        lever = self.X_WT[:3, :3] @ self._p_Ttip
        force = -on_tool[3:]
        return Wrench(-on_tool[:3] - cross(lever, force), force)

    @property
    def bushing_wrench(self) -> Wrench:
        """The grasp's load on the tool, spring and damper, about T, in T; zero when welded."""
        if self.welded:
            return Wrench.zero()
        if self._grasp_force is not None:
            to_C = relative(self._state, self._cell.tool_at, self._cell.gripper_at)
            return self._grasp_force.wrench(to_C.X_TC, to_C.V_TC, self.time)
        self._cell.context.SetDiscreteState(self._state)
        F = self._cell.bushing.CalcBushingSpatialForceOnFrameA(self._cell.context)
        self._cell.context.SetDiscreteState(self._before)  # where contact_wrench is to be read
        return Wrench(np.asarray(F.rotational()), np.asarray(F.translational()))

    @property
    def ft_wrench(self) -> Wrench:
        """Reading of a six-axis sensor between flange and gripper: the tool's load on the flange about E, in E.

        The gripper's own weight is tared. Of a welded tool it reads contact and weight.
        """
        X_ET = inverse_pose(self.arm.actual) @ self.X_WT
        on_gripper = self._static_load() if self.welded else Wrench.zero().minus(self.bushing_wrench)
        return on_gripper.about(-X_ET[:3, :3].T @ X_ET[:3, 3]).rotated(X_ET[:3, :3])

    def _static_load(self) -> Wrench:
        """Contact and weight of a welded tool, on the gripper, about T in T."""
        R_WT = self.X_WT[:3, :3]
        contact = Wrench.zero().minus(self.contact_wrench).rotated(R_WT.T).about(-self._p_Ttip)
        return contact.plus(weight_about_T(self.scenario.tool_mass, self.tool.center_of_mass, R_WT))

    @property
    def stiffness(self) -> Stiffness:
        """Of the grasp at the present width; of membranes, the diagonal of their tangent."""
        return self.grip.stiffness

    @property
    def membranes(self) -> MembraneHold | None:
        """Both membranes where the grasp is one of membranes."""
        return self.grip.hold if isinstance(self.grip, MembraneGrip) else None

    def carry(self, share: float) -> None:
        """Have a holder carry this share of the tool's weight, 0 to 1."""
        if not self.welded:
            self._cell.carry(share)

    def solve_membranes(self) -> None:
        """Solve them for the present pose, as when an image is taken; nothing where there are none."""
        if isinstance(self.grip, MembraneGrip):
            self.grip.solve(self.X_CT, self.time)

    def set_gripper_width(self, width: float) -> None:
        """Close to width [m]. Raises PlantError, see `Grip.set_width`."""
        self.grip.set_width(width)
        if isinstance(self.grip, Grip) and self._cell.bushing is not None:
            self._cell.set_bushing(self.grip)


def _pose_and_velocity(X: Array, angular_velocity: Array, velocity: Array) -> Array:
    """(13,) quaternion w, x, y, z, position, angular velocity and velocity in the world, as Drake orders them."""
    x, y, z, w = as_quaternion(X[:3, :3])
    return np.array((w, x, y, z, *X[:3, 3].tolist(), *angular_velocity.tolist(), *velocity.tolist()))
