# SPDX-License-Identifier: Apache-2.0
"""The simulated cell: Drake's bushing between gripper and tool, and a tilted table under the tool.

Bodies: a gripper whose motion is prescribed by the arm (so heavy that loads do not move it), and the free tool.
LinearBushingRollPitchYaw acts between them with frame A = T and frame C = C, the convention of `seed_core.bushing`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from seed_core.errors import SeedError
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, rotation_from_rpy, so3_exp, so3_log
from seed_sim.arm import Arm
from seed_sim.scenario import Scenario
from seed_sim.tools import ToolShape, shape_of

try:
    from pydrake import geometry as dg
    from pydrake.math import RigidTransform, RotationMatrix
    from pydrake.multibody import math as dm
    from pydrake.multibody import plant as dp
    from pydrake.multibody import tree as dt
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder
except ImportError as _error:  # pragma: no cover
    raise SeedError("the simulated cell needs Drake: pip install drake==1.51.1") from _error

DT = 1e-3  # [s] of a plant step
GRAVITY = 9.81  # [m/s^2], downwards
_GRIPPER_MASS = 1e4  # [kg]: 20 N move it by 1e-9 m in a step, after which it is put back
_POINT_RADIUS = 1e-3  # [m]


class PlantError(SeedError):
    """A plant that cannot be simulated."""


@dataclass(frozen=True)
class Surface:
    """The table that a seed has drawn: its frame in the world, z out of the surface."""

    X_WS: Array
    friction: float
    point_stiffness: float

    @property
    def normal(self) -> Array:
        return np.asarray(self.X_WS[:3, 2])


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
        self.surface = draw_surface(scenario, X_W_work, rng, len(self.shape.points))
        self.arm = Arm(scenario.servo, X_WE, rng)
        self._grip = 1.0  # stiffness of the grip relative to its nominal width
        self.width = scenario.grasp.nominal_width
        self._X_EC = self.hand.X_EC
        self._build(meshcat)
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
        while self._steps * DT < t - 1e-9:
            self._step()

    def drive(self, X_WE: Array, t: float) -> None:
        """Simulate until t [s] with the flange moved evenly from where it is to X_WE, by an arm outside."""
        n = max(round((t - self.time) / DT), 1)
        X0 = self.arm.reported
        turn, p0 = so3_log(X0[:3, :3].T @ X_WE[:3, :3]), X0[:3, 3]
        for i in range(1, n + 1):
            self.arm.reported = make_pose(X0[:3, :3] @ so3_exp(i / n * turn), p0 + i / n * (X_WE[:3, 3] - p0))
            self._step(outside=True)

    def _step(self, outside: bool = False) -> None:
        before = self._X_WC
        if not outside:
            self.arm.advance(self.time + DT, DT)
        after = self.arm.actual @ self._X_EC
        self._place_gripper(before, (after[:3, 3] - before[:3, 3]) / DT, so3_log(after[:3, :3] @ before[:3, :3].T) / DT)
        self._steps += 1
        self._simulator.AdvanceTo(self._steps * DT)
        self._X_WC = after
        if not np.isfinite(self._plant.GetPositions(self._context)).all():
            raise PlantError(f"the simulation of scenario '{self.scenario.name}' diverged at {self.time:.3f} s")

    def _place_gripper(self, X_WC: Array, v: Array, w: Array) -> None:
        """Position and velocity of the gripper at the beginning of a step."""
        q = RotationMatrix(X_WC[:3, :3]).ToQuaternion()
        state = self._plant.GetPositions(self._context, self._gripper_model)
        state[:] = (q.w(), q.x(), q.y(), q.z(), *X_WC[:3, 3])
        self._plant.SetPositions(self._context, self._gripper_model, state)
        self._plant.SetVelocities(self._context, self._gripper_model, np.concatenate([w, v]))

    def reset(self, X_WE: Array | None = None) -> None:
        """Arm at X_WE (default: where it is), tool in the grasp without displacement, at rest."""
        if X_WE is not None:
            self.arm.reset(X_WE)
        self._steps = 0
        self._X_WC = self.arm.actual @ self._X_EC
        self._simulator.get_mutable_context().SetTime(0.0)
        self._place_gripper(self._X_WC, np.zeros(3), np.zeros(3))
        self.grasp()
        self._simulator.Initialize()

    def grasp(self) -> None:
        """Take the tool anew: T coincides with C and rests relative to it."""
        if self.welded:
            return
        q = RotationMatrix(self._X_WC[:3, :3]).ToQuaternion()
        values = np.array((q.w(), q.x(), q.y(), q.z(), *self._X_WC[:3, 3]))
        self._plant.SetPositions(self._context, self._tool_model, values)
        self._plant.SetVelocities(self._context, self._tool_model, np.zeros(6))

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
        return np.asarray(self._plant.EvalBodyPoseInWorld(self._context, self._tool_body).GetAsMatrix4())

    @property
    def X_CT(self) -> Array:
        """True displacement of the tool in the grasp (4, 4)."""
        return inverse_pose(self._X_WC) @ self.X_WT

    @property
    def contact_wrench(self) -> Wrench:
        """What the tool does to the environment about its tip, written in the world [N m, N]."""
        results = self._plant.get_contact_results_output_port().Eval(self._context)
        X_WT = self.X_WT
        tip = X_WT[:3, :3] @ self.tool.X_Ttip[:3, 3] + X_WT[:3, 3]
        force, torque = np.zeros(3), np.zeros(3)
        for i in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(i)
            on_b = np.asarray(info.contact_force())
            f = on_b if info.bodyB_index() == self._world_index else -on_b
            force += f
            torque += np.cross(np.asarray(info.contact_point()) - tip, f)
        return Wrench(torque, force)

    @property
    def bushing_wrench(self) -> Wrench:
        """The spring's and damper's load on the tool about T, in T; zero when welded."""
        if self.welded:
            return Wrench.zero()
        F = self._bushing.CalcBushingSpatialForceOnFrameA(self._context)
        return Wrench(np.asarray(F.rotational()), np.asarray(F.translational()))

    @property
    def ft_wrench(self) -> Wrench:
        """What a six-axis sensor between flange and gripper reads of the tool: load on the flange about E, in E."""
        R_ET = self.arm.actual[:3, :3].T @ self.X_WT[:3, :3]
        p_TE = inverse_pose(self.X_WT) @ np.append(self.arm.actual[:3, 3], 1.0)
        on_gripper = Wrench(-self.bushing_wrench.torque, -self.bushing_wrench.force)
        return on_gripper.about(p_TE[:3]).rotated(R_ET)

    @property
    def pressure(self) -> float:
        """In the bubbles [hPa]."""
        g = self.scenario.grasp
        return g.nominal_pressure + g.pressure_slope * (g.nominal_width - self.width)

    def set_gripper_width(self, width: float) -> None:
        """Close to width [m]: a firmer grip is a stiffer one (Sec. VI of the paper).

        Raises:
            PlantError: the stiffness would leave 0.3 to 4 times the nominal one.
        """
        g = self.scenario.grasp
        grip = 1.0 + g.stiffening * (g.nominal_width - width)
        if not 0.3 <= grip <= 4.0:
            raise PlantError(f"gripper width = {width:.4f} m would make the grip {grip:.2f} times as stiff; 0.3 to 4 "
                             "times is possible")
        self.width, self._grip = width, grip
        s, (dr, dx) = g.stiffness.scaled(grip), self._damping()
        b = self._bushing
        b.SetTorqueStiffnessConstants(self._context, np.array(s.rotation))
        b.SetForceStiffnessConstants(self._context, np.array(s.translation))
        b.SetTorqueDampingConstants(self._context, dr)
        b.SetForceDampingConstants(self._context, dx)

    @property
    def stiffness(self) -> Any:
        """Of the plant at the present width."""
        return self.scenario.grasp.stiffness.scaled(self._grip)

    # --- building ----------------------------------------------------------------------------------------------
    def _damping(self) -> tuple[Array, Array]:
        s = self.scenario.grasp.stiffness.scaled(self._grip)
        ratio = 2.0 * self.scenario.grasp.damping_ratio
        m, inertia = self._mass, np.diag(self._inertia)
        return ratio * np.sqrt(np.array(s.rotation) * inertia), ratio * np.sqrt(np.array(s.translation) * m)

    def _build(self, meshcat: Any) -> None:
        builder = DiagramBuilder()
        self._plant, scene = dp.AddMultibodyPlantSceneGraph(builder, DT)
        self._plant.set_contact_model(dp.ContactModel.kPoint)
        self._plant.set_discrete_contact_approximation(dp.DiscreteContactApproximation.kLagged)
        self._gripper_model = self._plant.AddModelInstance("gripper")
        self._tool_model = self._plant.AddModelInstance("tool")
        self._gripper = self._plant.AddRigidBody(
            "gripper", self._gripper_model, dt.SpatialInertia.SolidBoxWithMass(_GRIPPER_MASS, 1, 1, 1)
        )
        for model in (self._gripper_model, self._tool_model):  # the tool's weight is applied below, without the pads'
            self._plant.set_gravity_enabled(model, False)
        self._add_tool()
        self._add_table()
        if meshcat is not None:
            self._draw(scene, builder, meshcat)
        self._plant.Finalize()
        self._world_index = self._plant.world_body().index()
        self._diagram = builder.Build()
        self._simulator = Simulator(self._diagram)
        root = self._simulator.get_mutable_context()
        self._context = self._plant.GetMyMutableContextFromRoot(root)
        if not self.welded:
            self._apply_weight()

    def _apply_weight(self) -> None:
        """The tool's weight at its centre of mass; that of the pads rests on the gripper."""
        weight = dp.ExternallyAppliedSpatialForce()
        weight.body_index = self._tool_body.index()
        weight.p_BoBq_B = np.array(self.tool.center_of_mass)
        mass = self.scenario.true_mass if self.scenario.true_mass is not None else self.tool.mass
        weight.F_Bq_W = dm.SpatialForce(np.zeros(3), np.array((0.0, 0.0, -mass * GRAVITY)))
        self._plant.get_applied_spatial_force_input_port().FixValue(self._context, [weight])

    def _add_tool(self) -> None:
        body = self._gripper
        if not self.welded:
            body = self._add_soft_tool()
        self._tool_body = body
        for i, point in enumerate(self.shape.points):
            # the sphere's lowest point is the contact point: its centre lies one radius nearer to the hand
            centre = point - _POINT_RADIUS * _unit(self.tool.X_Ttip[:3, 2])
            self._plant.RegisterCollisionGeometry(
                body, RigidTransform(centre), dg.Sphere(_POINT_RADIUS), f"tip{i}", self._material(2.0)
            )

    def _add_soft_tool(self) -> Any:
        g, s = self.scenario.grasp, self.scenario
        mass = s.true_mass if s.true_mass is not None else self.tool.mass
        com = np.array(self.tool.center_of_mass)
        self._mass = mass + g.pad_mass
        if self._mass <= 0.0:
            raise PlantError("a tool without mass cannot be simulated: give the tool a mass or the grasp a pad_mass")
        about_com = np.diag(self.shape.gyration**2) * mass
        self._inertia = about_com + mass * (com @ com * np.eye(3) - np.outer(com, com))
        self._inertia += np.eye(3) * g.pad_mass * g.pad_radius**2
        com_all = mass * com / self._mass
        inertia = dt.SpatialInertia(
            self._mass, com_all, _unit_inertia(self._inertia / self._mass)
        )
        body = self._plant.AddRigidBody("tool", self._tool_model, inertia)
        self._check_numerics()
        (dr, dx), k = self._damping(), g.stiffness
        self._bushing = self._plant.AddForceElement(
            dt.LinearBushingRollPitchYaw(
                body.body_frame(), self._gripper.body_frame(), k.rotation, dr, k.translation, dx
            )
        )
        return body

    def _check_numerics(self) -> None:
        """The bushing is integrated explicitly: stable only while omega dt < 1 and d dt / inertia < 1."""
        s, (dr, dx) = self.scenario.grasp.stiffness, self._damping()
        inertia = np.diag(self._inertia)
        worst = max(
            float(np.sqrt(np.array(s.rotation) / inertia).max()),
            float(np.sqrt(np.array(s.translation) / self._mass).max()),
            float((dr / inertia).max()),
            float((dx / self._mass).max()),
        )
        if worst * DT >= 1.0:
            raise PlantError(
                f"scenario '{self.scenario.name}': the grasp's fastest mode, {worst:.0f} rad/s, cannot be integrated "
                f"at {1e3 * DT:g} ms (below {1 / DT:g} rad/s is needed): give the tool the inertia of the gripper pads "
                "(grasp.pad_mass, grasp.pad_radius), or less stiffness or damping"
            )

    def _material(self, factor: float) -> Any:
        """Contact properties; two in series give the surface's stiffness, so each has twice that."""
        properties = dg.ProximityProperties()
        mu = self.surface.friction
        dg.AddContactMaterial(
            dissipation=self.scenario.table.dissipation, point_stiffness=factor * self.surface.point_stiffness,
            friction=dp.CoulombFriction(mu, mu), properties=properties,
        )
        return properties

    def _add_table(self) -> None:
        X = self.surface.X_WS @ make_pose(None, (0.0, 0.0, -0.5))
        self._plant.RegisterCollisionGeometry(
            self._plant.world_body(), RigidTransform(X), dg.Box(4.0, 4.0, 1.0), "table", self._material(2.0)
        )

    def _draw(self, scene: Any, builder: Any, meshcat: Any) -> None:
        colour = {"wood": [0.76, 0.6, 0.42, 1.0], "steel": [0.35, 0.4, 0.45, 1.0], "tool": [0.1, 0.45, 0.7, 1.0],
                  "bubble": [0.85, 0.85, 0.9, 0.6]}
        world, add = self._plant.world_body(), self._plant.RegisterVisualGeometry
        X = self.surface.X_WS @ make_pose(None, (0.12, 0.0, -0.01))
        add(world, RigidTransform(X), dg.Box(0.6, 0.5, 0.02), "table_top", colour["wood"])
        for i, (size, centre) in enumerate(self.shape.boxes):
            add(self._tool_body, RigidTransform(list(centre)), dg.Box(*size), f"tool{i}", colour["tool"])
        for name, y in (("left", 0.03), ("right", -0.03)):
            add(self._gripper, RigidTransform([0, y, 0]), dg.Ellipsoid(0.04, 0.02, 0.03), name, colour["bubble"])
            add(self._gripper, RigidTransform([0, 2.2 * y, -0.03]), dg.Box(0.09, 0.03, 0.1), f"{name}_finger",
                colour["steel"])
        add(self._gripper, RigidTransform([0, 0, -0.12]), dg.Box(0.09, 0.2, 0.06), "palm", colour["steel"])
        dg.MeshcatVisualizer.AddToBuilder(builder, scene, meshcat, dg.MeshcatVisualizerParams(publish_period=1 / 30))


def _unit(v: Array) -> Array:
    return v / sqrt(float(v @ v))


def _unit_inertia(about_origin: Array) -> Any:
    i = about_origin
    return dt.UnitInertia(i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])


def save_replay(meshcat: Any, path: Path) -> None:
    """Write Meshcat's scene and recording as one standalone page."""
    path.write_text(meshcat.StaticHtml(), encoding="utf-8")
