# SPDX-License-Identifier: Apache-2.0
"""Stiffness of a grasp between two gels, from their shear modulus and the size of the contact.

A gel of thickness t is bonded to its window and sticks to the tool on an area A = w h. It is sheared by G A / t and
pressed by E_a A / t, where gel that cannot flow out makes E_a = 4 G (1 + (w / 2 t)^2): Gent and Lindley's block, long
along h (Proc. Inst. Mech. Eng. 173, 1959). Each gel lies at y = +-r from C.
"""

import numpy as np

from seed_core.bushing import Stiffness


def gel_stiffness(modulus: float, thickness: float, width: float, height: float, radius: float) -> Stiffness:
    """Of two gels about C.

    Args:
        modulus: G [Pa]. thickness: t [m] of each.
        width, height: [m] of the contact along x and z, height being the longer.
        radius: r [m], half the tool's thickness.
    """
    area, shear = width * height, modulus / thickness
    press = 4.0 * shear * (1.0 + (0.5 * width / thickness) ** 2)
    roll = shear * area * radius**2 + press * width * height**3 / 12.0
    pitch = shear * area * (width**2 + height**2) / 12.0
    yaw = shear * area * radius**2 + press * height * width**3 / 12.0
    return Stiffness.from_vector(2.0 * np.array((roll, pitch, yaw, shear * area, press * area, shear * area)))
