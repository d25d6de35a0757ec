# SPDX-License-Identifier: Apache-2.0
"""The weight of a tool in a world: the controller's own `identify_payload`, in closed loop on the world's images."""

from seed_control.payload.identify import Payload, PayloadError
from seed_control.payload.motion import PayloadRun
from seed_control.tasks import load_task
from seed_core.hand import GRAVITY
from seed_core.wrench_model import WrenchModel
from seed_estimation.calibration.file import Calibration
from seed_sim.scenario import Scenario
from seed_sim.world.cell import make_plant, make_steering
from seed_sim.world.parameters import World

_LONGEST = 40.0  # [s]


def weigh(
    believed: Scenario,
    world: World,
    seed: int,
    estimator: str,
    calibration: Calibration | None,
    clock_offset: float,
    wrench_model: WrenchModel | None,
) -> tuple[Payload, float]:
    """Mass and centre of mass of the tool by the stiffness or the model that is believed.

    Returns:
        Them, and the standard deviation of the mass [kg] by what the controller states of the force that it hangs by.

    Args:
        believed: the cell as it is believed.
        world: what differs.
        seed: of the plant's and the images' noise.
        estimator: of relative poses.
        calibration, clock_offset, wrench_model: as found before.

    Raises:
        SeedError: the tool cannot be weighed, or the controller held.
    """
    plant = make_plant(believed, world, seed, load_task("squeegee"))
    steering = make_steering(
        plant,
        believed,
        world,
        seed,
        estimator=estimator,
        calibration=calibration,
        clock_offset=clock_offset,
        wrench_model=wrench_model,
    )
    run: PayloadRun | None = None
    deviation = 0.0  # [N]
    for step in range(round(_LONGEST * steering.rate)):
        t = step / steering.rate
        state = steering.sense(t)
        if run is None:
            if not state.enabled:
                steering.steer(t, None)
                continue
            run = PayloadRun(steering.controller.wrench_estimator, believed.tool, state)
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
