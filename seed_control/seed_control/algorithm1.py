# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1: force control of a one-dimensional series elastic actuator, the special case that SEED generalises.

A motor at x_motor pushes a load at x_load through a spring k. The wanted force becomes a wanted deformation, the wanted
deformation a motor position, and the position controller does the rest:

    d = f / k,    x_motor = x_load + d
"""

from seed_core.errors import SeedError


def motor_position(force: float, stiffness: float, load_position: float) -> float:
    """Motor position [m] at which the spring pushes the load with force [N]; Algorithm 1, lines 2 and 3.

    Raises:
        SeedError: the stiffness [N/m] is not above 0.
    """
    if not stiffness > 0.0:
        raise SeedError(f"stiffness = {stiffness} N/m must be > 0")
    return load_position + force / stiffness


def loop_gain(stiffness: float, environment_stiffness: float) -> float:
    """Share of the motor's motion that the load follows: below one, so the loop of Algorithm 1 settles at any delay.

    With the load position taken from the moment of its measurement, each pass maps a motor error e to gain x e.
    """
    return stiffness / (stiffness + environment_stiffness)
