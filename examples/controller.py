# SPDX-License-Identifier: Apache-2.0
"""The controller by itself: measurements in, a flange pose out, at each step. Here it presses on a table with 10 N.

Arm and grasp are a few lines: put the interface of your arm and your estimator in their place.
    pip install ./seed_core ./seed_control && python examples/controller.py
"""

import numpy as np

from seed_control import Controller, ControllerParameters, HybridSetpoint
from seed_core import DEFAULT_STIFFNESS, Hand, RelativePoseEstimate, Tool, Wrench, inverse_pose, pose_from_rpy

hand, tool = Hand(), Tool()
controller = Controller(ControllerParameters(), hand, tool, DEFAULT_STIFFNESS)
STEP = 1.0 / controller.parameters.rate  # [s]
GRASP, TABLE = DEFAULT_STIFFNESS.translation[2], 20e3  # [N/m] along z; the table's surface is at z = 0
NOISE, rng = 2e-5, np.random.default_rng(1)  # [m] of the estimate
WEIGHT = 9.81 * tool.mass  # [N]


def deflection(X_WC):
    """How far [m] weight and table push the tool up in the grasp, and the force [N] on the table."""
    free = (X_WC @ tool.X_Ttip)[2, 3] - WEIGHT / GRASP  # [m] height of the tip where no table is
    force = max(0.0, -free) / (1.0 / GRASP + 1.0 / TABLE)
    return (force - WEIGHT) / GRASP, force


X_W_tip = pose_from_rpy((np.pi, 0.0, 0.0), (0.45, 0.0, 0.0))  # the tool points down, its tip on the table
X_WE = pose_from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, 0.01)) @ X_W_tip @ inverse_pose(hand.X_EC @ tool.X_Ttip)
press = HybridSetpoint(
    X_W_tip,
    Wrench(torque=np.zeros(3), force=np.array((0.0, 0.0, -10.0))),  # of the tool on the table, in the world's axes
    force_projector=np.diag((0.0, 0.0, 1.0)),  # force along z, position along x and y
)
for i in range(round(3.0 / STEP)):
    t = i * STEP
    X_WC = X_WE @ hand.X_EC
    up, force = deflection(X_WC)
    controller.add_kinematics(t, X_WE)  # the arm: where its flange is
    if i % 5 == 0:  # the estimator: where the tool is in the gripper, here 50 times a second
        X_CT = np.eye(4)
        X_CT[:3, 3] = X_WC[:3, :3].T @ (0.0, 0.0, up) + NOISE * rng.standard_normal(3)
        controller.add_estimate(RelativePoseEstimate(t, X_CT, NOISE**2 * np.eye(6)))
    if i == 50:
        controller.enable(t)
        controller.set_setpoint(press, t)
    output = controller.step(t)
    if output.X_WE is not None:
        X_WE = output.X_WE  # the arm goes where it is sent
print(f"{output.state.mode}: {force:.1f} N on the table, {-output.state.estimated.force[2]:.1f} N by the estimate")
