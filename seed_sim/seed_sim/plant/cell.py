# SPDX-License-Identifier: Apache-2.0
"""Drake's model of the cell: a gripper with prescribed motion, the bushing, the tool, the table and what stands on it.

The gripper is a free body so heavy that no load moves it; its pose and velocity are set before each step. So the
bushing's damper sees how the gripper moves, which a frame fixed in the world would hide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seed_core.errors import FailedError
from seed_core.hand import GRAVITY
from seed_core.spatial import Array, make_pose
from seed_sim.plant.tools import (
    HOLE_CLEARANCE,
    HOLE_DEPTH,
    POINT_RADIUS,
    SCREW_DAMPING,
    SCREW_STIFFNESS,
    SLOT_CLEARANCE,
    SLOT_DEPTH,
    ToolInertia,
    ToolShape,
)
from seed_sim.scenario import Scenario

try:
    from pydrake import geometry as dg
    from pydrake.math import RigidTransform
    from pydrake.multibody import math as dm
    from pydrake.multibody import plant as dp
    from pydrake.multibody import tree as dt
    from pydrake.systems.framework import DiagramBuilder
except ImportError as _error:
    _missing: ImportError | None = _error
else:
    _missing = None

_GRIPPER_MASS = 1e4  # [kg]: 20 N move it by 1e-9 m in a step, after which it is put back
_WALL = 0.02  # [m] thickness of a hole's or slot's wall
_STEEL = 1e7  # [N/m] of a contact point of the tool, and of a wall
_COLOURS = {
    "wood": (0.76, 0.6, 0.42, 1.0),
    "steel": (0.35, 0.4, 0.45, 1.0),
    "tool": (0.1, 0.45, 0.7, 1.0),
    "bubble": (0.85, 0.85, 0.9, 0.6),
}


@dataclass(frozen=True)
class Surface:
    """The table that a seed has drawn: its frame in the world, z out of the surface."""

    X_WS: Array
    friction: float
    point_stiffness: float

    @property
    def normal(self) -> Array:
        """(3,) out of the surface, in the world."""
        return np.asarray(self.X_WS[:3, 2])


class Cell:
    """A finished Drake plant with its context. `bushing` is None when the tool is welded to the gripper."""

    def __init__(
        self,
        scenario: Scenario,
        surface: Surface,
        shape: ToolShape,
        inertia: ToolInertia | None,
        damping: tuple[Array, Array],
        dt_step: float,
        meshcat: Any,
    ) -> None:
        if _missing is not None:
            raise FailedError("the simulated cell needs Drake: pip install drake==1.51.1") from _missing
        self.surface, self.shape = surface, shape
        self.bushing: Any = None
        builder = DiagramBuilder()
        self.plant, scene = dp.AddMultibodyPlantSceneGraph(builder, dt_step)
        self.plant.SetUseSampledOutputPorts(False)
        self.plant.set_contact_model(dp.ContactModel.kPoint)
        self.plant.set_discrete_contact_approximation(dp.DiscreteContactApproximation.kTamsi)
        self.gripper_model = self.plant.AddModelInstance("gripper")
        self.tool_model = self.plant.AddModelInstance("tool") if inertia else self.gripper_model
        self.gripper = self.plant.AddRigidBody(
            "gripper", self.gripper_model, dt.SpatialInertia.SolidBoxWithMass(_GRIPPER_MASS, 1, 1, 1)
        )
        self.plant.set_gravity_enabled(self.gripper_model, False)
        self.tool = self._soft_tool(scenario, inertia, damping) if inertia else self.gripper
        self._touch(scenario)
        self._add_table()
        self._add_fixture(scenario.tool_kind)
        if meshcat is not None:
            self._draw(scene, builder, meshcat)
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.context = self.plant.GetMyMutableContextFromRoot(self.root)
        self.gripper_at, self.tool_at = self._place_in_state(self.gripper), self._place_in_state(self.tool)
        self.contact_forces = self.plant.get_generalized_contact_forces_output_port(self.tool_model)
        if inertia:
            self._weigh(inertia)

    def _place_in_state(self, body: Any) -> tuple[int, int]:
        """Index of a free body's quaternion (then its position), and of its angular velocity (then its velocity)."""
        nq = self.plant.num_positions()
        return body.floating_positions_start(), nq + body.floating_velocities_start_in_v()

    def _soft_tool(self, scenario: Scenario, inertia: ToolInertia, damping: tuple[Array, Array]) -> Any:
        unit = inertia.about_T / inertia.moving_mass
        body = self.plant.AddRigidBody(
            "tool",
            self.tool_model,
            dt.SpatialInertia(
                inertia.moving_mass,
                inertia.moving_com,
                dt.UnitInertia(unit[0, 0], unit[1, 1], unit[2, 2], unit[0, 1], unit[0, 2], unit[1, 2]),
            ),
        )
        self.plant.set_gravity_enabled(self.tool_model, False)  # see _weigh
        k = scenario.grasp.stiffness
        self.bushing = self.plant.AddForceElement(
            dt.LinearBushingRollPitchYaw(
                body.body_frame(), self.gripper.body_frame(), k.rotation, damping[0], k.translation, damping[1]
            )
        )
        return body

    def _weigh(self, inertia: ToolInertia) -> None:
        """The tool's weight at its centre of mass; that of the pads which move with it rests on the gripper."""
        weight = dp.ExternallyAppliedSpatialForce()
        weight.body_index = self.tool.index()
        weight.p_BoBq_B = inertia.com
        weight.F_Bq_W = dm.SpatialForce(np.zeros(3), np.array((0.0, 0.0, -inertia.mass * GRAVITY)))
        self.plant.get_applied_spatial_force_input_port().FixValue(self.context, [weight])

    def _material(self, stiffness: float, dissipation: float) -> Any:
        properties = dg.ProximityProperties()
        mu = self.surface.friction
        dg.AddContactMaterial(
            dissipation=dissipation,
            point_stiffness=stiffness,
            friction=dp.CoulombFriction(mu, mu),
            properties=properties,
        )
        return properties

    def _touch(self, scenario: Scenario) -> None:
        """Spheres whose lowest points are the contact points, hard compared with the table."""
        self._dissipation = scenario.table.dissipation
        down = scenario.tool.X_Ttip[:3, 2]
        material = self._material(_STEEL, self._dissipation)
        for i, point in enumerate(self.shape.points):
            self.plant.RegisterCollisionGeometry(
                self.tool, RigidTransform(point - POINT_RADIUS * down), dg.Sphere(POINT_RADIUS), f"tip{i}", material
            )

    def _add_table(self) -> None:
        k = self.surface.point_stiffness
        in_series = k * _STEEL / (_STEEL - k)  # with the tool's, this makes k
        self._wall(self.plant.world_body(), self.surface.X_WS, (0.0, 0.0, -0.5), (4.0, 4.0, 1.0), "table", in_series)

    def _wall(
        self,
        body: Any,
        X_body: Array,
        centre: tuple[float, ...],
        size: tuple[float, ...],
        name: str,
        stiffness: float,
        colour: str = "",
    ) -> None:
        X = RigidTransform(X_body @ make_pose(None, centre))
        material = self._material(stiffness, self._dissipation)
        self.plant.RegisterCollisionGeometry(body, X, dg.Box(*size), name, material)
        if colour:
            self.plant.RegisterVisualGeometry(body, X, dg.Box(*size), f"{name}_look", list(_COLOURS[colour]))

    def _add_fixture(self, kind: str) -> None:
        if kind == "peg":
            half = float(np.abs(self.shape.points[:, 0]).max()) + POINT_RADIUS + HOLE_CLEARANCE
            self._add_hole(half)
        if kind == "torque_driver":
            self._add_screw(POINT_RADIUS + SLOT_CLEARANCE)

    def _add_hole(self, half: float) -> None:
        """Four walls around a square hole on the table."""
        out, long = half + 0.5 * _WALL, 2.0 * (half + _WALL)
        for i, (x, y, a, b) in enumerate(
            ((out, 0.0, _WALL, long), (-out, 0.0, _WALL, long), (0.0, out, long, _WALL), (0.0, -out, long, _WALL))
        ):
            self._wall(
                self.plant.world_body(),
                self.surface.X_WS,
                (x, y, 0.5 * HOLE_DEPTH),
                (a, b, HOLE_DEPTH),
                f"hole{i}",
                _STEEL,
                "steel",
            )

    def _add_screw(self, half: float) -> None:
        """A slotted head that turns about the table's normal against a spring and a damper."""
        model = self.plant.AddModelInstance("screw")
        self.plant.set_gravity_enabled(model, False)
        screw = self.plant.AddRigidBody("screw", model, dt.SpatialInertia.SolidBoxWithMass(0.3, 0.05, 0.05, 0.02))
        fixed = self.plant.AddFrame(
            dt.FixedOffsetFrame("screw_axis", self.plant.world_frame(), RigidTransform(self.surface.X_WS))
        )
        joint = self.plant.AddJoint(
            dt.RevoluteJoint("screw", fixed, screw.body_frame(), [0.0, 0.0, 1.0], damping=SCREW_DAMPING)
        )
        self.plant.AddForceElement(dt.RevoluteSpring(joint, 0.0, SCREW_STIFFNESS))
        for name, side in (("slot_left", 1.0), ("slot_right", -1.0)):
            self._wall(
                screw,
                np.eye(4),
                (0.0, side * (half + 0.5 * _WALL), 0.5 * SLOT_DEPTH),
                (0.03, _WALL, SLOT_DEPTH),
                name,
                _STEEL,
                "steel",
            )

    def _draw(self, scene: Any, builder: Any, meshcat: Any) -> None:
        world, add = self.plant.world_body(), self.plant.RegisterVisualGeometry
        colour = {name: list(rgba) for name, rgba in _COLOURS.items()}
        X = self.surface.X_WS @ make_pose(None, (0.12, 0.0, -0.01))
        add(world, RigidTransform(X), dg.Box(0.6, 0.5, 0.02), "table_top", colour["wood"])
        for i, (size, centre) in enumerate(self.shape.boxes):
            add(self.tool, RigidTransform(list(centre)), dg.Box(*size), f"tool{i}", colour["tool"])
        for name, y in (("left", 0.03), ("right", -0.03)):
            add(self.gripper, RigidTransform([0, y, 0]), dg.Ellipsoid(0.04, 0.02, 0.03), name, colour["bubble"])
            add(
                self.gripper,
                RigidTransform([0, 2.2 * y, -0.03]),
                dg.Box(0.09, 0.03, 0.1),
                f"{name}_finger",
                colour["steel"],
            )
        add(self.gripper, RigidTransform([0, 0, -0.12]), dg.Box(0.09, 0.2, 0.06), "palm", colour["steel"])
        dg.MeshcatVisualizer.AddToBuilder(builder, scene, meshcat, dg.MeshcatVisualizerParams(publish_period=1 / 30))
