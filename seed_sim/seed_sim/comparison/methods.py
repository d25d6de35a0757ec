# SPDX-License-Identifier: Apache-2.0
"""The methods that are compared: how each holds the tool, what it senses, its law, and the grid it is tuned on."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from seed_control.tasks import Task
from seed_core.bushing import Stiffness
from seed_core.config import from_mapping
from seed_sim.closed_loop.baselines import BaselineSteering
from seed_sim.closed_loop.run import SeedSteering, Steering
from seed_sim.comparison.steering import PositionSteering, TorqueSteering
from seed_sim.plant.plant import Plant
from seed_sim.rivals.admittance import Admittance, AdmittanceSettings
from seed_sim.rivals.force_mode import ForceMode, ForceModeSettings
from seed_sim.rivals.force_pi import ForcePI, ForcePISettings
from seed_sim.rivals.impedance import (
    FRANKA,
    UR_DIRECT_TORQUE,
    Impedance,
    ImpedanceSettings,
    JointFriction,
    TorqueArm,
)
from seed_sim.rivals.sensor import IDEAL, JOINT_TORQUES, UR_E_SERIES, WRIST, ForceReader, ForceSensor
from seed_sim.scenario import Scenario

Settings = Mapping[str, float]
Grid = Mapping[str, tuple[float, ...]]
IDENTIFIED = 0.02  # deviation of each identified stiffness: with it the force is as far off as in hidden worlds

APPROACH = 0.01  # [m/s] of the rivals towards contact, gently; ours comes with 0.03

Build = Callable[[Plant, Scenario, Task, int, Settings], Steering]


@dataclass(frozen=True)
class Method:
    """One way to press with a wanted force.

    Attributes:
        name, short, says: for commands, for tables, and in a sentence.
        rigid: the tool is welded to the gripper; else the soft grasp holds it.
        build: its steering, from plant, scenario, task, seed and settings.
        grid: what its tuning tries; empty: nothing to tune.
        tuned_as: name of the method whose settings it has.
        bound: nobody can have it; it shows what would be reached, and wins nothing.
    """

    name: str
    short: str
    says: str
    rigid: bool
    build: Build
    grid: Grid
    tuned_as: str = ""
    bound: bool = False

    def points(self) -> list[dict[str, float]]:
        """All settings of the grid."""
        return [dict(zip(self.grid, values, strict=True)) for values in product(*self.grid.values())]


def _ours(law: str) -> Build:
    def build(plant: Plant, scenario: Scenario, task: Task, seed: int, settings: Settings) -> Steering:
        del task
        rng = np.random.default_rng([seed, 0x1D])
        k, off = scenario.grasp.stiffness, 1.0 + IDENTIFIED * rng.standard_normal(6)
        believed = Stiffness(
            tuple((np.array(k.rotation) * off[:3]).tolist()), tuple((np.array(k.translation) * off[3:]).tolist())
        )
        scenario = replace(
            scenario,
            grasp=replace(scenario.grasp, believed=believed),
            controller=scenario.controller | dict(settings),
        )
        return SeedSteering(plant, scenario, law, "noisy", seed)

    return build


def _ours_knowing(estimator: str) -> Build:
    """The law `seed`, the stiffness known exactly and poses without noise; 'noisy': they are late, 'truth': at once."""

    def build(plant: Plant, scenario: Scenario, task: Task, seed: int, settings: Settings) -> Steering:
        del task, settings
        measured = replace(scenario.measurement, position_noise=0.0, rotation_noise=0.0)
        return SeedSteering(plant, replace(scenario, measurement=measured), "seed", estimator, seed)

    return build


def _open_loop(plant: Plant, scenario: Scenario, task: Task, seed: int, settings: Settings) -> Steering:
    del scenario, seed, settings
    return BaselineSteering(plant, task, "open_loop")


def _position(law: Any, kind: Any, sensor: ForceSensor) -> Build:
    def build(plant: Plant, scenario: Scenario, task: Task, seed: int, settings: Settings) -> Steering:
        del scenario, task
        chosen = law(from_mapping(dict(settings), kind, "settings"))
        return PositionSteering(plant, chosen, ForceReader(sensor, seed), APPROACH)

    return build


def _torque(friction: JointFriction, sensor: ForceSensor) -> Build:
    def build(plant: Plant, scenario: Scenario, task: Task, seed: int, settings: Settings) -> Steering:
        del scenario, task
        law = Impedance(from_mapping(dict(settings), ImpedanceSettings, "settings"))
        sigma = np.array((JOINT_TORQUES.torque_offset,) * 3 + (JOINT_TORQUES.force_offset,) * 3)
        bias = sigma * np.random.default_rng([seed, 0xB1]).standard_normal(6)
        return TorqueSteering(plant, law, TorqueArm(friction, bias), ForceReader(sensor, seed), APPROACH)

    return build


_FORCE_MODE: Grid = {
    "damping": (0.005, 0.02, 0.05, 0.15, 0.5, 1.0),
    "gain_scaling": (0.005, 0.015, 0.05, 0.15, 0.5, 2.0),
}
_ADMITTANCE: Grid = {
    "mass": (2.0, 10.0, 50.0),
    "stiffness": (2.0, 20.0),
    "damping_ratio": (3.0, 10.0, 30.0),
    "filter_coefficient": (0.05, 0.3),
}
_STIFF_ADMITTANCE: Grid = {
    "mass": (3.0, 10.0, 50.0),
    "stiffness": (2.0, 20.0),
    "damping_ratio": (10.0, 30.0, 100.0, 300.0),
    "filter_coefficient": (0.05, 0.3),
}
_PI: Grid = {
    "gain": (3e-4, 1e-3, 3e-3, 1e-2, 3e-2),
    "integral_time": (0.03, 0.1, 0.3),
    "filter_time": (0.0, 0.02),
}
_IMPEDANCE: Grid = {"damping": (30.0, 100.0, 300.0, 1000.0), "integral": (0.0, 3.0, 10.0, 30.0), "lever": (0.05, 0.15)}

METHODS = (
    Method("seed", "ours", "soft grasp, poses with noise and delay, stiffness as identified", False, _ours("seed"), {}),
    Method("published", "Alg. 2", "the paper's law, with the same grasp and poses", False, _ours("published"), {}),
    Method("open loop", "open", "the taught path in the soft grasp; nothing is measured", False, _open_loop, {}),
    Method("PI", "PI", "welded, PI on a wrist sensor", True, _position(ForcePI, ForcePISettings, WRIST), _PI),
    Method("PI, soft", "PI soft", "the same above our grasp", False, _position(ForcePI, ForcePISettings, WRIST), _PI),
    Method(
        "ideal sensor",
        "ideal",
        "welded, PI with a sensor without noise, delay or offset, which nobody can buy",
        True,
        _position(ForcePI, ForcePISettings, IDEAL),
        {},
        "PI",
        bound=True,
    ),
    Method(
        "force mode",
        "UR",
        "welded, UR's force mode",
        True,
        _position(ForceMode, ForceModeSettings, UR_E_SERIES),
        _FORCE_MODE,
    ),
    Method(
        "force mode, soft",
        "UR soft",
        "the same above our grasp",
        False,
        _position(ForceMode, ForceModeSettings, UR_E_SERIES),
        _FORCE_MODE,
    ),
    Method(
        "admittance",
        "adm.",
        "welded, ros2_control's admittance_controller on a wrist sensor",
        True,
        _position(Admittance, AdmittanceSettings, WRIST),
        _STIFF_ADMITTANCE,
    ),
    Method(
        "admittance, soft",
        "adm. soft",
        "the same above our grasp",
        False,
        _position(Admittance, AdmittanceSettings, WRIST),
        _ADMITTANCE,
    ),
    Method(
        "impedance",
        "Franka",
        "welded, torques and joint torque sensors as of a Franka",
        True,
        _torque(FRANKA, JOINT_TORQUES),
        _IMPEDANCE,
    ),
    Method(
        "direct torque",
        "UR torque",
        "welded, UR's direct torque control with its flange sensor",
        True,
        _torque(UR_DIRECT_TORQUE, UR_E_SERIES),
        {},
        "impedance",
    ),
)
# Only run when they are named: what noise and lateness of the poses cost
FURTHER = (
    Method(
        "seed, no noise",
        "no noise",
        "ours with poses that are late but exact, the stiffness known",
        False,
        _ours_knowing("noisy"),
        {},
        bound=True,
    ),
    Method(
        "seed, at once",
        "at once",
        "ours with the exact pose at every step of the control, the stiffness known",
        False,
        _ours_knowing("truth"),
        {},
        bound=True,
    ),
)
ALL = {m.name: m for m in (*METHODS, *FURTHER)}
OURS = "seed"
QUICK = ("seed", "force mode", "admittance")


def method_named(name: str) -> Method:
    """The method of that name; KeyError for none."""
    return ALL[name]
