# SPDX-License-Identifier: Apache-2.0
"""The weight of a tool in a world: the controller's own `identify_payload`, in closed loop on the world's images."""

from seed_control.payload.identify import Payload, PayloadError
from seed_control.payload.motion import PayloadRun
from seed_control.tasks import load_task
from seed_core.hand import GRAVITY
from seed_sim.world.belief import Belief
from seed_sim.world.cell import make_plant, make_steering
from seed_sim.world.parameters import World

_LONGEST = 40.0  # [s]


def weigh(belief: Belief, world: World, seed: int, estimator: str) -> tuple[Payload, float]:
    """Mass and centre of mass of the tool by the stiffness or the model that is believed.

    Args:
        belief: what was found before.
        world: what differs from it.
        seed: of the plant's and the images' noise.
        estimator: of relative poses.

    Returns:
        Them, and the standard deviation of the mass [kg] by what the controller states of the force that it hangs by.

    Raises:
        SeedError: the tool cannot be weighed, or the controller held.
    """
    plant = make_plant(belief.scenario, world, seed, load_task("squeegee"))
    steering = make_steering(plant, belief, world, seed, estimator=estimator)
    run: PayloadRun | None = None
    deviation = 0.0  # [N]
    for step in range(round(_LONGEST * steering.rate)):
        t = step / steering.rate
        state = steering.sense(t)
        if run is None:
            if not state.enabled:
                steering.steer(t, None)
                continue
            run = PayloadRun(steering.controller.wrench_estimator, belief.scenario.tool, state)
        if state.deviation is not None:
            deviation = max(deviation, float(state.deviation.force.min()))
        status = run.step(t, state)
        if status.done:
            if status.failed or status.cancelled:
                raise PayloadError(f"the tool was not weighed: {status.message}")
            return run.result(), deviation / GRAVITY
        if refusal := steering.steer(t, status.setpoint):
            raise PayloadError(f"the tool was not weighed: {refusal}")
    raise PayloadError(f"the tool was not weighed within {_LONGEST:g} s")
