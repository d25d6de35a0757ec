# SPDX-License-Identifier: Apache-2.0
"""The identification of a world's grasp on a force/torque sensor, by the suite's own procedure.

The sensor and its faults are those of `./seed identify`, drawn from the seed; the spring is the world's, and poses come
from the arm's kinematics with the flange as it is believed, as docs/identification.md recommends.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seed_core.bushing import Bushing, Stiffness
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hysteretic.spring import HystereticSpring
from seed_core.spatial import Array, inverse_pose, make_pose
from seed_sim.campaigns import spread
from seed_sim.closed_loop.progress import Progress
from seed_sim.identification.cell import SimulatedCell
from seed_sim.identification.scenario import HiddenGrasp, IdentificationScenario
from seed_sim.identification.session import simulate
from seed_sim.scenario import Scenario, load_scenario, tactile_of
from seed_sim.world.cameras import true_hand
from seed_sim.world.draw import draw_world
from seed_sim.world.parameters import World
from seed_sim.world.spring import WorldSpring
from seed_sysid.fit.analysis import Analysis, analyse
from seed_sysid.fit.hysteretic_fit import fit_hysteretic
from seed_sysid.parameters import ExcitationParameters, Procedure
from seed_sysid.report.summary import stiffness_file
from seed_sysid.stiffness_map import AXES, wrench_transform

HUNG, PRESSED = 0.0024, 0.0105  # [m] of deflection along z: by the tool's weight, then by a task of 10 N
# As far along x and z as a task of 10 N deflects the grasp: what is beyond the poses identified is guessed.
EXCITATION = ExcitationParameters(translation=(0.009, 0.005, 0.009))
WORK = (10.0, 0.0, 10.0)  # [N] a press of 10 N, dragged along x with a friction of 1
WORK_LIMIT = 20.0  # [N] with what a pose may miss that load by


@dataclass(frozen=True)
class Identified:
    """The stiffness at the scenario's grip, the analysis behind it, and figures of both against the truth."""

    stiffness: Stiffness
    analysis: Analysis
    figures: dict[str, Any]


class WorldCell(SimulatedCell):
    """The cell of an identification with the grasp and the flange of a world."""

    def __init__(self, scenario: IdentificationScenario, seed: int, believed: Scenario, world: World) -> None:
        super().__init__(scenario, seed)
        self.spring = WorldSpring(believed.grasp.stiffness, world.spring)
        X_EC = believed.hand.X_EC
        self._X_KC = inverse_pose(X_EC) @ true_hand(believed.hand, world).X_EC  # C as it is, in C by kinematics
        self._to_kinematic = wrench_transform(self._X_KC)

    def _spring(self, X_TC: Array, grip: int) -> Array:
        del grip
        X = inverse_pose(self._X_KC) @ X_TC @ self._X_KC
        return np.asarray(self._to_kinematic @ self.spring.static(X, self.stamp).vector())


def identification_of(scenario: Scenario) -> IdentificationScenario:
    """One grip of a scenario, at the procedure's defaults; its sensor has the faults that are drawn there."""
    grasp = scenario.grasp
    return IdentificationScenario(
        name=scenario.name,
        grasp=HiddenGrasp(
            stiffness=grasp.stiffness,
            spread=0.0,
            scatter=(0.0,) * 6,
            pressure=grasp.nominal_pressure,
            pressure_per_width=-grasp.pressure_slope,
        ),
        hand=scenario.hand,
        tactile=tactile_of(scenario),
        procedure=Procedure(widths=[grasp.nominal_width], excitation=EXCITATION),
    )


def membrane_identification_of(scenario: Scenario) -> IdentificationScenario:
    """The same of a grasp between membranes: at the procedure's own excitation, and loaded as by a task of 10 N."""
    s = identification_of(scenario)
    excitation = ExcitationParameters(work_force=WORK, work_tip=tuple(scenario.tool.X_Ttip[:3, 3].tolist()))
    limits = replace(s.procedure.limits, force=WORK_LIMIT)
    procedure = replace(s.procedure, excitation=excitation, limits=limits)
    return replace(s, grasp=replace(s.grasp, kind="membrane"), membrane=scenario.membrane, procedure=procedure)


def identify(believed: Scenario, world: World, seed: int, progress: Progress | None = None) -> Identified:
    """Run the procedure of `identification_of` and fit its samples.

    Args:
        believed: the cell as it is believed.
        world: what differs.
        seed: of the sensor and its faults.
        progress: is told the share of the poses.

    Raises:
        SeedError: the run ended early, or its data give no stiffness.
    """
    scenario = identification_of(believed)
    cell = WorldCell(scenario, seed, believed, world)
    data, _ = simulate(scenario, seed, None, cell=cell, progress=progress)
    analysis = analyse(data, "kinematic", scenario.procedure.fit)
    stiffness_file(analysis, "")  # refuses what is undetermined, as for a user
    g = analysis.nominal
    found, true = analysis.solution.value.stiffness[g], cell.spring.stiffness.vector()
    half = analysis.solution.half_width[g]
    figures = {
        "found": dict(zip(AXES, found.tolist(), strict=True)),
        "half_width": dict(zip(AXES, half.tolist(), strict=True)),
        "drawn": dict(zip(AXES, true.tolist(), strict=True)),
        "error": dict(zip(AXES, (found / true - 1.0).tolist(), strict=True)),
        "covered": dict(zip(AXES, (np.abs(found - true) <= half).tolist(), strict=True)),
        "hysteretic": list(analysis.hysteretic),
        "warnings": list(analysis.warnings),
        "minutes": cell.stamp / 60.0,
    }
    return Identified(Stiffness.from_vector(found), analysis, figures)


def identify_draws(draws: Sequence[int]) -> dict[str, Any]:
    """The stiffness of `nominal` in the world of each draw, linear and with stiffening and hysteresis.

    Returns:
        By draw and axis: stiffness drawn and found, with intervals, by both fits; and the error of the force at
        PRESSED, pressed after hanging, with the deviation that the model states. Share of intervals that cover.
    """
    runs = [_one(d) for d in draws]
    good = [r for r in runs if "error" not in r]
    summary: dict[str, Any] = {"draws": len(runs), "failed": [r["draw"] for r in runs if "error" in r]}
    if good:
        errors = {k: np.abs([r["pressed"][k] - r["pressed"]["true"] for r in good]) for k in ("linear", "hysteretic")}
        summary["force_error"] = {k: spread(v.tolist()) for k, v in errors.items()}
        stated = np.array([r["pressed"]["stated"] for r in good])
        summary["within_two_deviations"] = float(np.mean(errors["hysteretic"] <= 2.0 * stated))
        for fit in ("linear", "hysteretic"):
            summary[f"covered_{fit}"] = float(np.mean([list(r["covered"][fit].values()) for r in good]))
    return {"draws": runs, "summary": summary}


def _one(draw: int) -> dict[str, Any]:
    scenario, world = load_scenario("nominal"), draw_world(draw)
    try:
        found = identify(scenario, world, draw)
        fit = fit_hysteretic(found.analysis)
    except SeedError as error:
        return {"draw": draw, "error": str(error)}
    spring, model = WorldSpring(scenario.grasp.stiffness, world.spring), HystereticSpring(fit.identified)
    for z in np.concatenate([np.linspace(0.0, -HUNG, 10), np.linspace(-HUNG, PRESSED, 40)]):
        X_TC = make_pose(None, (0.0, 0.0, z))
        true = spring.static(X_TC).force[2]
        told = model.spring(RelativePoseEstimate(0.0, inverse_pose(X_TC), covariance=1e-12 * np.eye(6)))
    linear = Bushing(found.stiffness).wrench(make_pose(None, (0.0, 0.0, PRESSED))).force[2]
    drawn, k, std = spring.stiffness.vector(), fit.identified.stiffness, fit.std[:, 0]
    return {
        "draw": draw,
        **{key: found.figures[key] for key in ("drawn", "found", "half_width")},
        "hysteretic": dict(zip(AXES, k.tolist(), strict=True)),
        "hysteretic_std": dict(zip(AXES, std.tolist(), strict=True)),
        "covered": {
            "linear": found.figures["covered"],
            "hysteretic": dict(zip(AXES, (np.abs(k - drawn) <= 2.0 * std).tolist(), strict=True)),
        },
        "pressed": {
            "true": float(true),
            "linear": float(linear),
            "hysteretic": float(told.wrench.force[2]),
            "stated": float(np.sqrt(told.covariance[5, 5])),
        },
    }


def table(result: dict[str, Any]) -> str:
    """The figures as text."""
    head = "".join(f"{axis:>8s}" for axis in AXES)
    lines = [
        f"error of the stiffness [%], linear fit, then hysteretic; force at {1e3 * PRESSED:g} mm [N]",
        f"draw{head}  |{head}  |    true  linear  hyst.  stated",
    ]
    for r in result["draws"]:
        if "error" in r:
            lines.append(f"{r['draw']:4d}  {r['error']}")
            continue
        cells = [
            "".join(f"{100 * (r[fit][a] / r['drawn'][a] - 1):8.1f}" for a in AXES) for fit in ("found", "hysteretic")
        ]
        p = r["pressed"]
        force = f"{p['true']:8.2f}{p['linear']:8.2f}{p['hysteretic']:7.2f}{p['stated']:8.2f}"
        lines.append(f"{r['draw']:4d}{cells[0]}  |{cells[1]}  |{force}")
    s = result["summary"]
    if "force_error" in s:
        for fit, spread in s["force_error"].items():
            figures = ", ".join(f"{name} {v:.3f} N" for name, v in spread.items())
            lines.append(f"{fit}: force off by {figures}; intervals cover {s[f'covered_{fit}']:.0%}")
        lines.append(f"force within two stated deviations: {s['within_two_deviations']:.0%}")
    return "\n".join(lines)
