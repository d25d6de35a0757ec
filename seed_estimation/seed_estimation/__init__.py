# SPDX-License-Identifier: Apache-2.0
"""Pose of the grasped tool and contact patches from two tactile cameras (Sec. VII of the paper).

from seed_core.hand import Hand
from seed_estimation import Estimator, EstimatorParameters

estimator = Estimator(EstimatorParameters(), Hand(), cameras)  # a PinholeCamera by finger: "left", "right"
estimator.capture_reference(frames)    # the bubbles touch nothing; two frames or more, each a TactileImages by finger
estimator.initialize_grasp(frames)     # the tool is grasped: T := C
estimate = estimator.update(images, stamp)  # X_CT with covariance, axes observed, validity and a reason
"""

from seed_estimation.contact.patch import ContactPatch
from seed_estimation.estimator import Estimator
from seed_estimation.images.camera import CameraError, PinholeCamera
from seed_estimation.images.checks import EstimatorError
from seed_estimation.images.tactile_images import TactileImages
from seed_estimation.parameters import METHODS, EstimatorParameters

__all__ = [
    "METHODS",
    "CameraError",
    "ContactPatch",
    "Estimator",
    "EstimatorError",
    "EstimatorParameters",
    "PinholeCamera",
    "TactileImages",
]
