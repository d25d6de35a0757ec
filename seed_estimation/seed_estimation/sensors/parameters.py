# SPDX-License-Identifier: Apache-2.0
"""What an estimator over sensors of any kind can be told."""

from dataclasses import dataclass

from seed_core.config import field


@dataclass(frozen=True)
class SensorEstimatorParameters:
    """Time and trust."""

    iterations: int = field(6, low=1, high=50, doc="most Gauss-Newton steps of one frame")
    lock: float = field(0.6, low=0.1, high=0.999, doc="share of the material explained below which a track is lost")
    patience: int = field(5, low=1, high=1000, doc="frames lost in a row, while touching, from which the tool has slid")
    max_skew: float = field(0.025, unit="s", low=0.0, high=1.0, doc="largest difference of the two fingers' stamps")
    max_std_translation: float = field(0.0003, unit="m", low=1e-6, high=0.1, doc="beyond it an axis is not observed")
    max_std_rotation: float = field(0.035, unit="rad", low=1e-4, high=1.0, doc="beyond it an axis is not observed")
    share_std: float = field(0.015, low=0.0, high=0.5, doc="deviation of each axis, as a share of the whole motion")
