# SPDX-License-Identifier: Apache-2.0
"""Scenario files: the simulated cell, its measurement and the controller's belief, in one YAML format."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.config import ConfigError, field, load_file
from seed_core.hand import DEFAULT_STIFFNESS, Hand, Tool
from seed_core.program.files import shared_path
from seed_core.program.suggestions import did_you_mean
from seed_core.vector3 import Vector3
from seed_core.wrench_settings import ReferenceSettings, WrenchSettings
from seed_sim.gel.parameters import GelParameters
from seed_sim.gripper.gripper import GripperSection
from seed_sim.membrane.parameters import MembraneParameters, random_membrane, unlike_fingers
from seed_sim.plant.holes.parameters import HoleSection
from seed_sim.plant.surfaces.section import SurfaceSection
from seed_sim.plant.tools import BLADE, TOOLS
from seed_sim.tactile.parameters import HANDLE, TactileParameters
from seed_sim.tactile.trajectory import TrajectorySection

_DOT_PITCH, _DOT_JITTER = (0.0037, 0.0041), (0.18, 0.28)  # [m], [pitches] of random membranes: 390 to 440 are in view
_FIRM = (0.0155, 0.0185)  # [m] squeeze
Range = tuple[float, float]
Folder = tuple[str, str]  # package, and folder below it
SHIPPED: Folder = ("seed_sim", "config/scenarios")
GRASPS = ("bushing", "membrane")
PRESSURE_FAULTS = ("none", "silent", "stuck", "left_silent", "left_stuck", "pascal", "gauge")
COLUMNS = ("nominal", "soft_environment", "slow_servo", "light_damping", "stiff_grip")


@dataclass(frozen=True)
class GraspSection:
    """The compliant element of the plant."""

    kind: str = field("bushing", choices=GRASPS, doc="a spring of known stiffness, or membranes with mechanics")
    stiffness: Stiffness = field(DEFAULT_STIFFNESS, doc="of a bushing at the grip's nominal width")
    believed: Stiffness | None = field(
        None, doc="what the controller believes; default: a bushing's, or the membranes' tangent at the grasp"
    )
    damping_ratio: float = field(0.3, low=0.0, high=2.0, doc="on every axis")
    pad_mass: float = field(0.0, unit="kg", low=0.0, high=1.0, doc="of the gripper pads that move with the tool")
    pad_radius: float = field(0.02, unit="m", low=0.0, high=0.2, doc="radius of gyration of those pads")
    taken_under: Vector3 = field(
        (0.0, 0.0, 0.0),
        unit="N",
        low=-100.0,
        high=100.0,
        doc="what the grasp bore when it was initialized: force on the tool in C; its weight if it hung, 0 if carried",
    )
    nominal_width: float = field(0.02, unit="m", low=0.0, high=0.2, doc="distance of the fingers at which K holds")
    stiffening: float = field(
        60.0, unit="1/m", low=0.0, high=1000.0, doc="relative rise of K per closed metre, bushing"
    )
    nominal_pressure: float = field(1030.0, unit="hPa", low=900.0, high=1500.0, doc="at that width, bushing")
    grip_force: float = field(
        5.0, unit="N", low=0.1, high=200.0, doc="push of each finger at the nominal width, bushing"
    )
    grip_rise: float = field(
        800.0, unit="N/m", low=1.0, high=1e5, doc="its rise per closed metre, where the grasp is a bushing"
    )
    pressure_slope: float = field(1500.0, unit="hPa/m", low=0.0, high=1e5, doc="rise per closed metre, bushing")


@dataclass(frozen=True)
class PressureSection:
    """The pressure sensors of both bubbles."""

    noise: float = field(0.0, unit="hPa", low=0.0, high=100.0, doc="white, of each reading")
    offset: float = field(0.0, unit="hPa", low=-500.0, high=500.0, doc="of both sensors")
    fault: str = field("none", choices=PRESSURE_FAULTS, doc="what is wrong with the left one, or with all")
    fault_from: float = field(0.0, unit="s", low=0.0, high=3600.0, doc="since when, on the plant's clock")


@dataclass(frozen=True)
class ServoSection:
    """The position-controlled arm."""

    arm: str = field("cartesian", choices=("cartesian", "ur5e", "ur10e"), doc="kinematics between command and flange")
    lag: float = field(0.015, unit="s", low=0.0, high=0.5, doc="first-order lag of the servo")
    dead_time: float = field(0.0, unit="s", low=0.0, high=0.2, doc="between command and any motion")
    repeatability: float = field(0.1, unit="mm", low=0.0, high=5.0, doc="unreported error of position, each axis")


@dataclass(frozen=True)
class TableSection:
    """The surface under the tool; ranges are drawn from the seed."""

    tilt_x: Range = field((-2.0, 2.0), unit="deg", low=-30, high=30, span=True, doc="about the work frame's x")
    tilt_y: Range = field((-2.0, 2.0), unit="deg", low=-30, high=30, span=True, doc="about the work frame's y")
    height: Range = field(
        (-3.0, 3.0), unit="mm", low=-50, high=50, span=True, doc="of the surface at the work frame's origin"
    )
    friction: float = field(0.4, low=0.0, high=2.0, doc="Coulomb, static and dynamic")
    contact_stiffness: float = field(8000.0, unit="N/m", low=10.0, high=1e6, doc="of each contact point")
    total_stiffness: float | None = field(
        None, unit="N/m", low=10.0, high=1e7, doc="of all points together instead; less than 1e7 for each"
    )
    dissipation: float = field(5.0, unit="s/m", low=0.0, high=100.0, doc="Hunt and Crossley's")
    edge: float = field(2.0, unit="m", low=-2.0, high=2.0, doc="where a plane ends, along the work frame's x")
    surface: SurfaceSection = field(SurfaceSection(), doc="its shape and motion; a plane at rest if left out")


@dataclass(frozen=True)
class ArmSensorSection:
    """The arm's own force/torque reading at the flange."""

    present: bool = field(False, doc="the arm has one")
    rate: float = field(125.0, unit="Hz", low=10.0, high=1000.0, doc="of the readings")
    force_noise: float = field(0.3, unit="N", low=0.0, high=20.0, doc="white, per axis and reading")
    torque_noise: float = field(0.03, unit="N m", low=0.0, high=2.0, doc="likewise")
    force_zero: float = field(3.0, unit="N", low=0.0, high=50.0, doc="offset of each axis, drawn up to this")
    torque_zero: float = field(0.1, unit="N m", low=0.0, high=5.0, doc="likewise")
    force_drift: float = field(0.005, unit="N/s", low=0.0, high=1.0, doc="of the offset, drawn up to this")
    torque_drift: float = field(5e-4, unit="N m/s", low=0.0, high=0.1, doc="likewise")
    gain: float = field(0.01, low=0.0, high=0.5, doc="error of each axis' gain, drawn up to this")


@dataclass(frozen=True)
class MeasurementSection:
    """How relative poses are measured when no images are rendered, and when they arrive."""

    rate: float = field(45.0, unit="Hz", low=1.0, high=500.0, doc="of the cameras")
    delay: float | None = field(
        None,
        unit="s",
        low=0.0,
        high=0.5,
        doc="from image to estimate; default 50 ms with noise, 30 ms with images, 0 with truth",
    )
    position_noise: float = field(0.3, unit="mm", low=0.0, high=10.0, doc="white, per axis and frame")
    rotation_noise: float = field(0.5, unit="deg", low=0.0, high=10.0, doc="white, per axis and frame")
    stamp_error: float = field(
        0.0, unit="s", low=-0.5, high=0.5, doc="by which the stamps of images are ahead of the robot's clock"
    )
    kinematics_noise: float = field(0.0, unit="mm", low=0.0, high=10.0, doc="white, of the reported flange position")
    arm_sensor: ArmSensorSection = field(ArmSensorSection(), doc="the arm's own force/torque reading")


@dataclass(frozen=True)
class Scenario:
    """Everything that one run depends on besides its seed."""

    name: str = field("nominal", doc="name")
    description: str = field("", doc="one sentence")
    hand: Hand = field(Hand(), doc="frames of the hand")
    tool_kind: str = field("squeegee", choices=TOOLS, doc="shape of the tool")
    blade_width: float = field(BLADE, unit="m", low=0.01, high=0.5, doc="of a squeegee's blade")
    tool: Tool = field(Tool(), doc="frames and weight of the tool, also what the controller believes")
    true_mass: float | None = field(None, unit="kg", low=0.0, high=20.0, doc="of the plant's tool; default as believed")
    grasp: GraspSection = field(GraspSection(), doc="the compliant element")
    gripper: GripperSection = field(GripperSection(), doc="rate, latency and force limit of the gripper")
    membrane: MembraneParameters = field(MembraneParameters(), doc="both membranes, with grasp.kind: membrane")
    pressure: PressureSection = field(PressureSection(), doc="the pressure sensors")
    servo: ServoSection = field(ServoSection(), doc="the arm")
    table: TableSection = field(TableSection(), doc="the surface")
    hole: HoleSection | None = field(None, doc="a plate with a hole on the table, and what goes into it")
    measurement: MeasurementSection = field(MeasurementSection(), doc="relative poses")
    tactile: TactileParameters = field(TactileParameters(), doc="rendered images")
    gel: GelParameters | None = field(
        None, doc="gels in place of bubbles, for --estimator gel; see docs/other_sensors.md"
    )
    trajectory: TrajectorySection = field(TrajectorySection(), doc="motion in the grasp of ./seed validate")
    estimator: dict[str, Any] = field({}, doc="parameters of the estimator that differ from their defaults")
    calibrate: bool = field(False, doc="run the calibration of range and cameras before the estimator")
    slip_share: float = field(0.0, low=0.0, high=0.9, doc="of the tool's motion that the membrane does not follow")
    wrench: WrenchSettings = field(WrenchSettings(), doc="what the controller's wrench comes from")
    reference: ReferenceSettings = field(ReferenceSettings(), doc="what the controller checks the wrench against")
    controller: dict[str, Any] = field({}, doc="parameters of the controller that differ from their defaults")

    @property
    def tool_mass(self) -> float:
        """Mass of the plant's tool [kg]; the controller believes in `tool.mass`."""
        return self.tool.mass if self.true_mass is None else self.true_mass


def tactile_of(scenario: Scenario) -> TactileParameters:
    """The renderer's parameters of a scenario, whoever renders: live, in closed loop, to validate or to identify."""
    p = replace(scenario.tactile, slip=scenario.tactile.slip or scenario.slip_share)
    if scenario.grasp.kind == "membrane":
        p = replace(p, rim_x=scenario.membrane.rim_x, rim_z=scenario.membrane.rim_z)
    return p


def on_membrane(scenario: Scenario, seed: int, firm: bool = False) -> Scenario:
    """The scenario with its tool between two membranes that are drawn from the seed, not quite alike, dots included.

    firm: as a tool needs that presses with 10 N at a lever of 12 cm: its handle has flat sides, and the gripper
    squeezes with 20 to 45 N.
    """
    rng = np.random.default_rng((seed, 0xD075))
    tactile = replace(
        scenario.tactile, dot_pitch=float(rng.uniform(*_DOT_PITCH)), dot_jitter=float(rng.uniform(*_DOT_JITTER))
    )
    grasp = replace(scenario.grasp, kind="membrane", believed=None)
    membrane = unlike_fingers(random_membrane(seed), seed)
    if firm:
        membrane, tactile = replace(membrane, squeeze=float(rng.uniform(*_FIRM))), replace(tactile, tool=HANDLE)
    return replace(scenario, grasp=grasp, membrane=membrane, tactile=tactile)


def shipped_scenarios(folder: Folder = SHIPPED) -> list[str]:
    """Names of the scenario files that come with the suite in a folder."""
    return sorted(f.stem for f in shared_path(*folder).glob("*.yaml"))


def scenario_file(name_or_path: str | Path, *folders: Folder) -> Path | None:
    """A file that is named by its path, else NAME.yaml in the first of the folders that has it, else None."""
    if Path(name_or_path).suffix in (".yaml", ".yml"):
        return Path(name_or_path)
    files = [shared_path(*folder) / f"{name_or_path}.yaml" for folder in folders]
    return next((file for file in files if file.is_file()), None)


def load_scenario(name_or_path: str | Path, *folders: Folder) -> Scenario:
    """A scenario from a file, or by name from the folders, SHIPPED if none are given.

    Raises:
        ConfigError: no such file or name, or a value in it that cannot be used.
    """
    looked_in = folders or (SHIPPED,)
    file = scenario_file(name_or_path, *looked_in)
    if file is None:
        known = shipped_scenarios(looked_in[0])
        meant = did_you_mean(str(name_or_path), known)
        raise ConfigError(
            f"scenario '{name_or_path}' is unknown; shipped: {', '.join(known)}; or name a .yaml file{meant}"
        )
    return load_file(file, Scenario)
