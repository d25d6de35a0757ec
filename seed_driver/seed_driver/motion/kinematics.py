# SPDX-License-Identifier: Apache-2.0
"""The arm's kinematics as configured: published lengths, or those of a calibration file of ur_calibration."""

from __future__ import annotations

from seed_driver.config import DriverConfig
from seed_ur.kinematics import URKinematics


def arm_kinematics(config: DriverConfig) -> URKinematics:
    """Kinematics for `config`; raises SeedError when the calibration file is missing or wrong."""
    nominal = URKinematics.for_model(config.model)
    if not config.calibration_file:
        return nominal
    from seed_driver.motion.calibration import load_calibration  # SciPy and YAML only where they are needed

    return load_calibration(config.calibration_file, nominal)
