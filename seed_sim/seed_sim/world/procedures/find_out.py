# SPDX-License-Identifier: Apache-2.0
"""What the suite finds out about a world by its own procedures, and what it believes after them.

Calibration of range and cameras (`./seed calibrate`), identification on a force/torque sensor (`./seed identify`), the
comparison of clocks in the motion between its poses, and the tool's weight (`identify_payload`), in this order; each
runs in that very world on what the ones before have found. Nothing else is handed on.
"""

from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from seed_control.payload.identify import PayloadError
from seed_core.bushing import Stiffness
from seed_core.errors import SeedError
from seed_core.wrench_settings import WrenchModelName
from seed_estimation.calibration.calibrate import MembraneShape, calibrate
from seed_estimation.calibration.file import Calibration
from seed_sim.closed_loop.progress import Progress
from seed_sim.scenario import Scenario
from seed_sim.tactile.parameters import ToolShape
from seed_sim.world.belief import Belief
from seed_sim.world.cameras import WorldCameras
from seed_sim.world.parameters import Kind, World
from seed_sim.world.procedures.captures import captures
from seed_sim.world.procedures.clocks import compare_clocks
from seed_sim.world.procedures.identify import identify
from seed_sim.world.procedures.membranes import identify_membranes
from seed_sim.world.procedures.weigh import weigh
from seed_sysid.fit.hysteretic_fit import HystereticFit, fit_hysteretic
from seed_sysid.stiffness_map import AXES, CHANNELS

STEPS: dict[Kind, tuple[str, ...]] = {
    "spring": ("calibrate", "identify", "clocks", "weigh"),
    "membrane": ("identify_membranes", "clocks"),
}
MODELS: dict[Kind, tuple[str, ...]] = {  # of the wrench that the identification of a world is made into
    "spring": ("bushing", "hysteretic"),
    "membrane": ("bushing", "hysteretic", "membrane"),
}
_NEEDED = ("identify", "identify_membranes")  # without what it finds no force is controlled
_DISAGREE = 3.0  # [standard deviations] from which the stated mass is not believed
_FRAMES, _PER_POSE = 60, 10  # images of the empty bubbles, and of each pose of the cylinder


def find_out(
    scenario: Scenario,
    world: World,
    seed: int,
    method: str = "rigid_fit",
    model: WrenchModelName = "hysteretic",
    progress: Progress | None = None,
) -> Belief:
    """Run the procedures of a world, or tell the scenario's own values where it runs none.

    `progress` is told which of them runs, and how far an identification is.

    Raises:
        SeedError: the identification does not come to its end, or is not made into this model.
    """
    check_model(world.kind, model)
    if not world.procedures.run:
        return Belief(told(scenario, world))
    work = _Work(scenario, world, seed, method, model, progress)
    for name in STEPS[world.kind]:
        began = perf_counter()
        work.tell(0.0, name.replace("_", " "))
        try:
            getattr(work, name)()
        except SeedError as error:
            if name in _NEEDED:
                raise SeedError(f"{name.replace('_', ' ')}: {error}") from error
            work.believe(problems=(*work.belief.problems, f"{name}: {error}"))
        work.belief.seconds[name] = perf_counter() - began
    return work.belief


def check_model(kind: Kind, model: str) -> None:
    """Raises SeedError: in a world of this kind no identification is made into this model of the wrench."""
    if model in MODELS[kind]:
        return
    if model in MODELS["membrane"]:
        raise SeedError(f"model = {model}: the grasp of this world is a spring; give --membranes, or another model")
    raise SeedError(
        f"model = {model}: no identification of a hidden world is made into it; those that are: "
        f"{', '.join(MODELS[kind])}. To add one: docs/architecture.md, Add a part of your own"
    )


def calibrate_cameras(scenario: Scenario, world: World, seed: int) -> Calibration:
    """`./seed calibrate` in a world: range by the dome as it is drawn, camera poses by a grasped cylinder.

    Raises:
        SeedError: the captures do not show what they should.
    """
    tool = scenario.tactile.tool
    if not tool.round:  # a cylinder is taken for it
        scenario = replace(scenario, tactile=replace(scenario.tactile, tool=ToolShape()))
    data = captures(WorldCameras(scenario, world, seed), _FRAMES, _PER_POSE)
    rim_x, rim_y, height = world.procedures.dome
    drawn: MembraneShape = data.pop("shape")
    shape = replace(
        drawn,
        rim_x=drawn.rim_x * (1.0 + rim_x),
        rim_y=drawn.rim_y * (1.0 + rim_y),
        height=drawn.height * (1.0 + height),
    )
    return calibrate(**data, shape=shape, hand=scenario.hand)


def told(scenario: Scenario, world: World) -> Scenario:
    """The scenario with the stiffness that the suite is told: the world's own, times the factor on it."""
    k = (scenario.grasp.believed or scenario.grasp.stiffness).vector() * np.array(world.procedures.stiffness)
    return replace(scenario, grasp=replace(scenario.grasp, believed=Stiffness.from_vector(k)))


class _Work:
    """The procedures of one world, and what is believed after those that have run."""

    def __init__(
        self,
        scenario: Scenario,
        world: World,
        seed: int,
        method: str,
        model: WrenchModelName,
        progress: Progress | None,
    ) -> None:
        self.belief = Belief(told(scenario, world))
        self._world, self._seed, self._method, self._model = world, seed, method, model
        self.tell: Progress = progress or (lambda *_: None)

    def believe(self, **found: Any) -> None:
        """From now on, by the names of `Belief`."""
        self.belief = replace(self.belief, **found)

    def _believe_stiffness(self, stiffness: Stiffness) -> None:
        scenario = self.belief.scenario
        self.believe(scenario=replace(scenario, grasp=replace(scenario.grasp, believed=stiffness)))

    def calibrate(self) -> None:
        """Range by the drawn dome, camera poses by a grasped cylinder."""
        self.believe(calibration=calibrate_cameras(self.belief.scenario, self._world, self._seed))

    def identify(self) -> None:
        """The stiffness, on a fixed force/torque sensor."""
        found = identify(self.belief.scenario, self._world, self._seed, progress=self._identifying)
        self.belief.figures["identify"] = found.figures
        self._believe_stiffness(found.stiffness)
        if self._model == "hysteretic":
            fit = fit_hysteretic(found.analysis)
            self.believe(spring=fit.identified)
            self.belief.figures["hysteretic"] = figures_of(fit)

    def identify_membranes(self) -> None:
        """Stiffness and membrane map, on a fixed force/torque sensor, as the world's cameras see the membranes."""
        scenario, analysis = identify_membranes(
            self.belief.scenario, self._world, self._seed, self._method, self._identifying
        )
        self.believe(scenario=scenario)
        found = Stiffness.from_vector(analysis.solution.value.stiffness[analysis.nominal])
        self._believe_stiffness(found)
        assert analysis.membrane is not None
        share = dict(zip(CHANNELS, analysis.membrane.fit.share.tolist(), strict=True))
        stiffness = dict(zip(AXES, found.vector().tolist(), strict=True))
        self.belief.figures["membranes"] = {
            "unexplained": share, "stiffness": stiffness, "squeeze": scenario.membrane.squeeze,
        }  # fmt: skip
        if self._model == "membrane":
            self.believe(membranes=analysis.membrane.file)
        elif self._model == "hysteretic":
            self.believe(spring=fit_hysteretic(analysis).identified)

    def _identifying(self, share: float, what: str) -> None:
        self.tell(share, f"identify: {what}")

    def clocks(self) -> None:
        """The offset of the cameras' clock."""
        belief = self.belief
        found = compare_clocks(belief.scenario, self._world, self._seed, self._method, belief.calibration)
        belief.figures["clocks"] = {"offset": found.value, "std": found.std}
        self.believe(clock_offset=found.value)

    def weigh(self) -> None:
        """The tool's mass: as stated and as it hangs, each by how well it is known; if they disagree, as it hangs.

        Its centre of mass stays as drawn, which a spring cannot tell better, unless the mass disagrees.
        """
        payload, deviation = weigh(self.belief, self._world, self._seed, self._method)
        if not payload.mass > 0.0:
            raise PayloadError(f"a tool of {payload.mass:g} kg is none")
        scenario = self.belief.scenario
        stated, of_stated = scenario.tool, scenario.reference.mass_deviation * scenario.tool.mass
        mass, com = payload.mass, stated.center_of_mass
        if abs(payload.mass - stated.mass) < _DISAGREE * np.hypot(deviation, of_stated):
            mass = stated.mass + (payload.mass - stated.mass) * of_stated**2 / (of_stated**2 + deviation**2)
        else:
            known = np.isfinite(payload.center_of_mass_std)
            x, y, z = np.where(known, payload.center_of_mass, com).tolist()
            com = (x, y, z)
        self.belief.figures["weigh"] = {
            "hanging": payload.mass, "deviation": deviation, "mass": mass, "center_of_mass": com,
        }  # fmt: skip
        self.believe(scenario=replace(scenario, tool=replace(stated, mass=mass, center_of_mass=com)))


def figures_of(fit: HystereticFit) -> dict[str, Any]:
    """The spring as plain data, by axis."""
    s = fit.identified
    share = s.friction.sum(axis=0) / (s.stiffness * s.largest)
    columns = {
        "stiffness": s.stiffness,
        "rise": s.rise * s.largest / s.stiffness,
        "friction": share,
        "largest": s.largest,
    }
    out: dict[str, Any] = {k: dict(zip(AXES, v.tolist(), strict=True)) for k, v in columns.items()}
    out["stiffness_std"] = dict(zip(AXES, fit.std[:, 0].tolist(), strict=True))
    left = {"left": fit.left.tolist(), "left_linear": fit.left_linear.tolist()}
    return out | left | {"centre_mm": (1e3 * s.centre).tolist()}
