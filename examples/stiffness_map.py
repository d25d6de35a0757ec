# SPDX-License-Identifier: Apache-2.0
"""The stiffness map of a grasp (Theorem 1): from a displacement of the gripper to the wrench on the tool, and back.

Needs seed_core only:  pip install ./seed_core && python examples/stiffness_map.py
"""

import numpy as np

from seed_core import Bushing, Stiffness, Wrench, pose_from_rpy

# A soft grasp is a spring between the gripper (frame C) and the tool (frame T). Six numbers describe it: how stiff it
# is about and along each axis.
stiffness = Stiffness(
    rotation=(4.0, 3.0, 4.0),  # [N m/rad] about x, y, z
    translation=(800.0, 1200.0, 800.0),  # [N/m] along x, y, z
)
grasp = Bushing(stiffness)

# Forward. X_TC is where the gripper is, seen from the tool: here 10 mm further along z, tilted by 5 degrees about x.
X_TC = pose_from_rpy(np.deg2rad((5.0, 0.0, 0.0)), (0.0, 0.0, 0.010))
wrench_T = grasp.wrench(X_TC)
print("displaced by 10 mm and 5 degrees, the grasp pulls the tool with")
print(f"  force  {np.round(wrench_T.force, 3)} N")
print(f"  torque {np.round(wrench_T.torque, 3)} N m")

# Inverse. Which displacement gives a force of 10 N along z and no torque? This is what a controller asks to press.
wanted = Wrench(torque=np.zeros(3), force=np.array((0.0, 0.0, 10.0)))
X_TC = grasp.pose(wanted)
print(f"10 N along z need the gripper {1e3 * X_TC[2, 3]:.1f} mm further along z")

# The two are inverse to each other, to rounding.
error = grasp.wrench(X_TC).minus(wanted).vector()
assert np.abs(error).max() < 1e-10
