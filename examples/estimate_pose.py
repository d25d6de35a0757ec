# SPDX-License-Identifier: Apache-2.0
"""The pose of a grasped tool from the depth and infrared images of two tactile cameras (Sec. VII of the paper).

The images are rendered here, so this needs the simulator:  pip install ./seed_{core,ur,estimation,control,sysid,sim}
With cameras of your own, fill TactileImages(depth, ir, stamp) from them; then seed_core and seed_estimation will do.
"""

import numpy as np

from seed_core import Hand, inverse_pose, pose_from_rpy, so3_log
from seed_estimation import Estimator, EstimatorParameters
from seed_sim import TactileParameters, TactileRenderer

hand = Hand()  # where the two cameras sit in the gripper; the defaults are a parallel gripper with two bubbles
bubbles = TactileRenderer(TactileParameters(), hand, seed=1)

# The estimator knows the hand and the lenses: a PinholeCamera for each finger.
estimator = Estimator(EstimatorParameters(), hand, bubbles.cameras)

# 1. The bubbles touch nothing: what they look like at rest.
estimator.capture_reference([bubbles.no_contact(stamp=0.1 * i) for i in range(5)])

# 2. The gripper has closed on the tool. From now on every pose is relative to this moment.
held = np.eye(4)
estimator.initialize_grasp([bubbles.render(held, stamp=1.0 + 0.1 * i) for i in range(3)])

# 3. The tool is pressed and turns in the grasp, little by little. Each finger's images are two arrays (H, W) of one
#    moment: the distance along the optical axis [m], NaN where there is none, and the infrared amplitude.
for share in np.linspace(0.1, 1.0, 10):
    true_X_CT = pose_from_rpy(share * np.deg2rad((4.0, 0.0, 2.0)), share * np.array((0.0, 0.0, -0.003)))
    images = bubbles.render(true_X_CT, stamp=2.0 + share)
    estimate = estimator.update(images, stamp=2.0 + share)

if not estimate.valid:  # bad images never raise: the estimate says what is wrong with them
    raise SystemExit(estimate.reason)
error = inverse_pose(true_X_CT) @ estimate.X_CT
millimetres, degrees = 1e3 * np.linalg.norm(error[:3, 3]), np.rad2deg(np.linalg.norm(so3_log(error[:3, :3])))
print(f"pose of the tool in the gripper, from images of {images['left'].depth.shape} pixels")
print(np.round(estimate.X_CT, 4))
print(
    f"error {1e3 * np.linalg.norm(error[:3, 3]):.2f} mm, {np.rad2deg(np.linalg.norm(so3_log(error[:3, :3]))):.2f} deg"
)
print("standard deviations", np.sqrt(np.diag(estimate.covariance)).round(5), "rad, m")  # rotation first
