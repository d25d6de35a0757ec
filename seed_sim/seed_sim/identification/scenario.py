# SPDX-License-Identifier: Apache-2.0
"""Scenarios of a simulated identification: the grasp, the sensor and its faults, in one strict YAML file."""

from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.config import ConfigError, field, load_file, parse_yaml, read_text
from seed_core.hand import DEFAULT_STIFFNESS, Hand, Tool
from seed_core.vector3 import Vector3
from seed_sim.membrane.parameters import MembraneParameters
from seed_sim.scenario import (
    GRASPS,
    Scenario,
    load_scenario,
    on_membrane,
    scenario_file,
    shipped_scenarios,
    tactile_of,
)
from seed_sim.tactile.parameters import TactileParameters
from seed_sysid.parameters import Procedure
from seed_sysid.stiffness_map import AXES

SHIPPED = ("seed_sim", "config/identify")
_CLOSER = 0.5  # of the widths' distances
Vector6 = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class SensorFaults:
    """A six-axis force/torque sensor as it is."""

    force_noise: float = field(0.1, unit="N", low=0.0, high=10.0, doc="standard deviation of each reading")
    torque_noise: float = field(0.003, unit="N m", low=0.0, high=1.0, doc="standard deviation of each reading")
    force_bias: float = field(0.0, unit="N", low=0.0, high=100.0, doc="largest bias per axis, drawn")
    torque_bias: float = field(0.0, unit="N m", low=0.0, high=10.0, doc="largest bias per axis, drawn")
    force_drift: float = field(0.1, unit="N", low=0.0, high=10.0, doc="largest drift per axis over 10 min, drawn")
    torque_drift: float = field(0.003, unit="N m", low=0.0, high=1.0, doc="largest drift per axis over 10 min, drawn")
    offset_mm: float = field(5.0, unit="mm", low=0.0, high=50.0, doc="size of the frame offset, direction drawn")
    offset_deg: float = field(3.0, unit="deg", low=0.0, high=30.0, doc="size of the turn of the frame, axis drawn")
    outliers: float = field(0.0, low=0.0, high=0.5, doc="share of poses at which something else loads the sensor")
    outlier_force: float = field(4.0, unit="N", low=0.0, high=50.0, doc="size of that load, direction drawn")
    outlier_torque: float = field(0.2, unit="N m", low=0.0, high=5.0, doc="size of that load, direction drawn")
    range_force: float = field(200.0, unit="N", low=0.1, high=5000.0, doc="where the sensor saturates")
    range_torque: float = field(10.0, unit="N m", low=0.01, high=500.0, doc="where the sensor saturates")


@dataclass(frozen=True)
class HiddenGrasp:
    """The stiffness that is to be found, drawn from the seed, and how it goes with the grip."""

    kind: str = field("bushing", choices=GRASPS, doc="a bushing as below, or the scenario's `membrane`")
    stiffness: Stiffness = field(DEFAULT_STIFFNESS, doc="centre of the draw, at the middle width")
    spread: float = field(0.4, low=0.0, high=0.8, doc="each stiffness is drawn within +- this share")
    slope: Vector6 = field(
        (0.025, 0.0, 0.0, 0.025, 0.02, 0.025), unit="1/hPa", low=-0.2, high=0.2, doc="relative, per axis"
    )
    scatter: Vector6 = field((0.0, 0.06, 0.06, 0.0, 0.0, 0.0), low=0.0, high=0.5, doc="from grip to grip, drawn")
    pressure: float = field(1030.0, unit="hPa", low=1.0, high=5000.0, doc="at the middle width")
    pressure_per_width: float = field(-1500.0, unit="hPa/m", low=-1e5, high=0.0, doc="closing squeezes the bubbles")
    pressure_noise: float = field(0.054, unit="hPa", low=0.0, high=10.0, doc="of each reading")
    settle_time: float = field(0.25, unit="s", low=0.001, high=10.0, doc="time constant of the membrane")
    creep: float = field(0.0, low=0.0, high=0.5, doc="share of the load that settles five times more slowly")
    hysteresis: dict[str, float] = field({}, unit="N m or N", low=0.0, high=50.0, doc="friction by axis name")
    yield_share: float = field(0.1, low=0.001, high=1.0, doc="of the axis' range until that friction slides")


@dataclass(frozen=True)
class Weight:
    """The calibrated weight of the procedure without a force sensor."""

    mass: float = field(0.5, unit="kg", low=0.01, high=10.0, doc="known mass")
    center_of_mass: Vector3 = field((0.0, 0.0, 0.0), unit="m", low=-0.5, high=0.5, doc="known centre of mass in T")


@dataclass(frozen=True)
class IdentificationScenario:
    """A simulated identification."""

    name: str = field("default", doc="name of the scenario")
    grasp: HiddenGrasp = field(HiddenGrasp())
    sensor: SensorFaults = field(SensorFaults())
    repeatability: float = field(6e-5, unit="m", low=0.0, high=0.01, doc="of the arm, per axis and pose")
    repeatability_deg: float = field(0.02, unit="deg", low=0.0, high=5.0, doc="of the arm, per axis and pose")
    rate: float = field(10.0, unit="1/s", low=2.0, high=1000.0, doc="readings per second")
    sensor_position: Vector3 = field((0.0, 0.0, 0.06), unit="m", low=-1.0, high=1.0, doc="nominal sensor frame in T")
    sensor_rpy_deg: Vector3 = field((180.0, 0.0, 30.0), unit="deg", low=-360.0, high=360.0, doc="its nominal turn")
    estimator: str = field("rigid_fit", doc="method of the pose estimator, for --poses estimator")
    tactile: TactileParameters = field(TactileParameters(), doc="rendered images, for --poses estimator")
    hand: Hand = field(Hand())
    tool: Tool = field(Tool(name="ft_sensor"))
    membrane: MembraneParameters = field(MembraneParameters(), doc="both membranes, with grasp.kind: membrane")
    procedure: Procedure = field(Procedure())
    weight: Weight = field(Weight())

    def __post_init__(self) -> None:
        for axis in self.grasp.hysteresis:
            if axis not in AXES:
                raise ConfigError(f"grasp.hysteresis: unknown axis '{axis}'; known: {', '.join(AXES)}")


def load(name: str) -> IdentificationScenario:
    """A scenario of identification by its file or its name in config/identify; or the grasp of one of seed_sim.

    Which of both a file is, the more of its keys tell.

    Raises:
        ConfigError: no such scenario, or a bad one.
    """
    file = Path(name) if Path(name).is_file() else scenario_file(name, SHIPPED)
    if file is None:
        known = ", ".join(shipped_scenarios(SHIPPED))
        raise ConfigError(f"scenario '{name}' is neither a YAML file nor one of: {known}")
    sections = parse_yaml(read_text(file), str(file)).value
    keys = set(sections) if isinstance(sections, dict) else set()
    of_cell, of_identification = (len(keys & {f.name for f in fields(c)}) for c in (Scenario, IdentificationScenario))
    if of_cell > of_identification:
        return from_simulation(file)
    try:
        return load_file(file, IdentificationScenario)
    except ConfigError:
        if of_cell == of_identification:
            with suppress(ConfigError):  # neither: the first message is the one to show
                return from_simulation(file)
        raise


def from_simulation(file: Path) -> IdentificationScenario:
    """The identification of the hand, grasp and bubbles in a scenario of seed_sim, other things at their defaults.

    The stiffness at the middle width is the scenario's very own; none is drawn.

    Raises:
        ConfigError: it is no such scenario.
    """
    sim = load_scenario(file)
    middle = sim.grasp.nominal_width
    widths = [w for w in (middle + 0.006, middle, middle - 0.006) if w >= 0.0]
    return IdentificationScenario(
        name=sim.name,
        grasp=HiddenGrasp(
            stiffness=sim.grasp.stiffness,
            spread=0.0,
            scatter=(0.0,) * 6,
            pressure=sim.grasp.nominal_pressure,
            pressure_per_width=-sim.grasp.pressure_slope,
            kind=sim.grasp.kind,
        ),
        hand=sim.hand,
        tactile=tactile_of(sim),
        membrane=sim.membrane,
        procedure=Procedure(widths=widths),
    )


def identify_on_membrane(scenario: IdentificationScenario, seed: int) -> IdentificationScenario:
    """The scenario with its tool between two membranes drawn from the seed, gripped as firmly as a task of 10 N asks.

    Width by width the squeeze differs by a few millimetres, by which membranes change much: widths lie closer.
    """
    drawn = on_membrane(Scenario(tactile=scenario.tactile), seed, firm=True)
    widths = scenario.procedure.widths
    middle = float(np.median(widths))
    closer = [middle + _CLOSER * (w - middle) for w in widths]
    return replace(
        scenario,
        grasp=replace(scenario.grasp, kind="membrane"),
        membrane=drawn.membrane,
        tactile=tactile_of(drawn),
        procedure=replace(scenario.procedure, widths=closer),
    )
