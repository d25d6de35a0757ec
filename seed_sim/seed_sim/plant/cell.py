# SPDX-License-Identifier: Apache-2.0
"""Drake's model of the cell: a gripper with prescribed motion, the grasp, the tool, the table and what stands on it.

The gripper is a free body so heavy that no load moves it; its pose and velocity are set before each step. So the
bushing's damper sees how the gripper moves, which a frame fixed in the world would hide.
"""

from typing import Any

import numpy as np
from pydrake import geometry as dg
from pydrake.math import RigidTransform
from pydrake.multibody import math as dm
from pydrake.multibody import plant as dp
from pydrake.multibody import tree as dt
from pydrake.systems.framework import DiagramBuilder

from seed_core.hand import GRAVITY
from seed_core.spatial import Array, make_pose
from seed_sim.plant.grip import Grip, PlantError
from seed_sim.plant.surfaces.patches import Patches
from seed_sim.plant.table import Surface
from seed_sim.plant.tools import (
    HOLE_CLEARANCE,
    HOLE_DEPTH,
    POINT_RADIUS,
    SCREW_DAMPING,
    SCREW_STIFFNESS,
    SLOT_CLEARANCE,
    SLOT_DEPTH,
    WALL,
    ContactShape,
    ToolInertia,
)
from seed_sim.scenario import Scenario

_GRIPPER_MASS = 1e4  # [kg]: 20 N move it by 1e-9 m in a step, after which it is put back
_HARD = 1e7  # [N/m] of a contact point of the tool, and of a wall


class Cell:
    """A finished Drake plant with its context.

    Attributes:
        bushing: Drake's; None when the tool is welded to the gripper, or the grasp's load comes from outside.
        patches: what a table that is not flat is touched by; None of a flat one.
        centres: (n, 3) [m] in T of the spheres that touch.

    Args:
        scenario: the simulated cell.
        surface: of the table, as the seed has drawn it.
        shape: of the tool.
        inertia: of the tool; None welds it to the gripper.
        grip: constants of the bushing; None: there is none, the grasp's load comes from outside.
        step: [s].
    """

    def __init__(
        self,
        scenario: Scenario,
        surface: Surface,
        shape: ContactShape,
        inertia: ToolInertia | None,
        grip: Grip | None,
        step: float,
    ) -> None:
        self._surface, self._dissipation = surface, scenario.table.dissipation
        self.bushing: Any = None
        self._walls: list[Any] = []
        self._inertia, self._up = inertia, np.array(scenario.hand.up)
        builder = DiagramBuilder()
        self.plant, scene = dp.AddMultibodyPlantSceneGraph(builder, step)
        self.plant.SetUseSampledOutputPorts(False)
        self.plant.set_contact_model(dp.ContactModel.kPoint)
        self.plant.set_discrete_contact_approximation(dp.DiscreteContactApproximation.kTamsi)
        gripper_model = self.plant.AddModelInstance("gripper")
        tool_model = self.plant.AddModelInstance("tool") if inertia else gripper_model
        heavy = dt.SpatialInertia.SolidBoxWithMass(_GRIPPER_MASS, 1, 1, 1)
        self.gripper = self.plant.AddRigidBody("gripper", gripper_model, heavy)
        self.plant.set_gravity_enabled(gripper_model, False)
        self.tool = self._held_tool(tool_model, inertia, grip) if inertia else self.gripper
        self.centres = shape.points - shape.radius * scenario.tool.X_Ttip[:3, 2]  # (n, 3) [m] in T
        # with a hole the table is `seed_sim.plant.holes`, whose load comes from outside
        tips = [] if scenario.hole else self._add_contact_points(shape)
        if not surface.shapes and scenario.hole is None:
            self._add_table()
        if scenario.tool_kind == "peg":
            self._add_hole(float(np.abs(shape.points[:, 0]).max()) + POINT_RADIUS + HOLE_CLEARANCE)
        if scenario.tool_kind == "torque_driver":
            self._add_screw(POINT_RADIUS + SLOT_CLEARANCE)
        self.patches: Patches | None = None
        if surface.shapes:
            of_table = self._properties(self._in_series())
            self.patches = Patches(self.plant, scene, surface, tips, self._walls, of_table)
        self.plant.Finalize()
        if self.patches is not None:
            self.patches.find()
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.gripper_at, self.tool_at = self._place_in_state(self.gripper), self._place_in_state(self.tool)
        self.contact_forces = self.plant.get_generalized_contact_forces_output_port(tool_model)
        if inertia:
            self._apply_weight(inertia)
        self._forces, self._tool_in_v = (
            np.zeros(self.plant.num_velocities()),
            self.tool.floating_velocities_start_in_v(),
        )
        self._applied: Any = None
        if inertia and (grip is None or scenario.hole is not None):
            port = self.plant.get_applied_generalized_force_input_port()
            self._applied = port.FixValue(self.context, self._forces)

    def carry(self, share: float) -> None:
        """Have something else carry this share of the tool's weight."""
        assert self._inertia is not None
        self._apply_weight(self._inertia, 1.0 - share)

    def apply(self, torque: Array, force: Array) -> None:
        """Load a held tool from outside with torque and force, (3,) [N m], [N] about T's origin, in the world."""
        if self._applied is None:
            return
        i = self._tool_in_v
        self._forces[i : i + 3], self._forces[i + 3 : i + 6] = torque, force
        self._applied.GetMutableData().get_mutable_value().SetFromVector(self._forces)

    def set_bushing(self, grip: Grip) -> None:
        """Give the bushing the constants of the grip."""
        stiffness, (rotational, translational) = grip.stiffness, grip.damping
        self.bushing.SetTorqueStiffnessConstants(self.context, np.array(stiffness.rotation))
        self.bushing.SetForceStiffnessConstants(self.context, np.array(stiffness.translation))
        self.bushing.SetTorqueDampingConstants(self.context, rotational)
        self.bushing.SetForceDampingConstants(self.context, translational)

    def _place_in_state(self, body: Any) -> tuple[int, int]:
        """Index of a free body's quaternion (then its position), and of its angular velocity (then its velocity)."""
        nq = self.plant.num_positions()
        return body.floating_positions_start(), nq + body.floating_velocities_start_in_v()

    def _held_tool(self, model: Any, inertia: ToolInertia, grip: Grip | None) -> Any:
        """A body, with the bushing between it and the gripper if there is one; its weight is applied by itself."""
        unit = inertia.about_T / inertia.moving_mass
        unit_inertia = dt.UnitInertia(unit[0, 0], unit[1, 1], unit[2, 2], unit[0, 1], unit[0, 2], unit[1, 2])
        spatial_inertia = dt.SpatialInertia(inertia.moving_mass, inertia.moving_com, unit_inertia)
        body = self.plant.AddRigidBody("tool", model, spatial_inertia)
        self.plant.set_gravity_enabled(model, False)
        if grip is None:
            return body
        k, d, frames = grip.stiffness, grip.damping, (body.body_frame(), self.gripper.body_frame())
        bushing = dt.LinearBushingRollPitchYaw(*frames, k.rotation, d[0], k.translation, d[1])
        self.bushing = self.plant.AddForceElement(bushing)
        return body

    def _apply_weight(self, inertia: ToolInertia, share: float = 1.0) -> None:
        """The tool's weight at its centre of mass; that of the pads which move with it rests on the gripper."""
        weight = dp.ExternallyAppliedSpatialForce()
        weight.body_index = self.tool.index()
        weight.p_BoBq_B = inertia.com
        weight.F_Bq_W = dm.SpatialForce(np.zeros(3), -share * inertia.mass * GRAVITY * self._up)
        self.plant.get_applied_spatial_force_input_port().FixValue(self.context, [weight])

    def _add_contact(self, body: Any, X: Any, shape: Any, name: str, stiffness: float) -> Any:
        """What touches, with the table's friction and dissipation, and a stiffness [N/m] per contact point."""
        return self.plant.RegisterCollisionGeometry(body, X, shape, name, self._properties(stiffness))

    def _properties(self, stiffness: float) -> Any:
        properties, mu = dg.ProximityProperties(), self._surface.friction
        friction = dp.CoulombFriction(mu, mu)
        dg.AddContactMaterial(
            dissipation=self._dissipation, point_stiffness=stiffness, friction=friction, properties=properties
        )
        return properties

    def _add_contact_points(self, shape: ContactShape) -> list[Any]:
        """Spheres whose lowest points are the contact points, hard compared with the table."""
        at = [RigidTransform(centre) for centre in self.centres]
        ball = dg.Sphere(shape.radius)
        return [self._add_contact(self.tool, X, ball, f"tip{i}", _HARD) for i, X in enumerate(at)]

    def _in_series(self) -> float:
        """[N/m] that makes the table's stiffness together with the tool's. Raises PlantError."""
        k = self._surface.point_stiffness
        if k >= _HARD:
            raise PlantError(
                f"table: stiffness of a contact point = {k:g} N/m must be less than the tool's own, {_HARD:g} N/m: "
                "lower table.total_stiffness, which the tool's points share"
            )
        return k * _HARD / (_HARD - k)

    def _add_table(self) -> None:
        X = RigidTransform(self._surface.X_WS @ make_pose(None, (self._surface.edge - 2.0, 0.0, -0.5)))
        self._add_contact(self.plant.world_body(), X, dg.Box(4.0, 4.0, 1.0), "table", self._in_series())

    def _add_wall(
        self, body: Any, X_body: Array, centre: tuple[float, ...], size: tuple[float, ...], name: str
    ) -> None:
        X, box = RigidTransform(X_body @ make_pose(None, centre)), dg.Box(*size)
        self._walls.append(self._add_contact(body, X, box, name, _HARD))

    def _add_hole(self, half: float) -> None:
        """Four walls around a square hole on the table."""
        out, long = half + 0.5 * WALL, 2.0 * (half + WALL)
        sides = ((out, 0.0, WALL, long), (-out, 0.0, WALL, long), (0.0, out, long, WALL), (0.0, -out, long, WALL))
        for i, (x, y, a, b) in enumerate(sides):
            centre, size = (x, y, 0.5 * HOLE_DEPTH), (a, b, HOLE_DEPTH)
            self._add_wall(self.plant.world_body(), self._surface.X_WS, centre, size, f"hole{i}")

    def _add_screw(self, half: float) -> None:
        """A slotted head that turns about the table's normal against a spring and a damper."""
        model = self.plant.AddModelInstance("screw")
        self.plant.set_gravity_enabled(model, False)
        screw = self.plant.AddRigidBody("screw", model, dt.SpatialInertia.SolidBoxWithMass(0.3, 0.05, 0.05, 0.02))
        X_WS = RigidTransform(self._surface.X_WS)
        axis = self.plant.AddFrame(dt.FixedOffsetFrame("screw_axis", self.plant.world_frame(), X_WS))
        joint = self.plant.AddJoint(
            dt.RevoluteJoint("screw", axis, screw.body_frame(), [0.0, 0.0, 1.0], damping=SCREW_DAMPING)
        )
        self.plant.AddForceElement(dt.RevoluteSpring(joint, 0.0, SCREW_STIFFNESS))
        for name, side in (("slot_left", 1.0), ("slot_right", -1.0)):
            centre = (0.0, side * (half + 0.5 * WALL), 0.5 * SLOT_DEPTH)
            self._add_wall(screw, np.eye(4), centre, (0.03, WALL, SLOT_DEPTH), name)
