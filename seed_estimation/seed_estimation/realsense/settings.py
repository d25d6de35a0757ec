# SPDX-License-Identifier: Apache-2.0
"""What is asked of the two cameras."""

from dataclasses import dataclass

from seed_core.config import ConfigError, field
from seed_core.hand import FINGERS_OF


@dataclass(frozen=True)
class RealSenseSettings:
    """Parameters of the node `cameras`."""

    left: str = field("", doc="serial number of the left bubble's camera; empty: the smaller one of two")
    right: str = field("", doc="serial number of the right bubble's camera; empty: the larger one of two")
    fingers: str = field("both", choices=tuple(FINGERS_OF), doc="which bubbles have a camera")
    recordings: list[str] = field([], doc="files of the library's recorder that are played in place of cameras on USB")
    model: str = field("D405", doc="that the camera's name must contain: others see nothing as near as a membrane")
    width: int = field(640, unit="px", low=64, high=1280, doc="of both images")
    height: int = field(480, unit="px", low=64, high=800, doc="of both images")
    rate: int = field(30, unit="Hz", low=5, high=90, doc="of both images")
    exposure: float = field(0.0, unit="us", low=0.0, high=200000.0, doc="of both images; 0: the camera's own choice")
    depth_unit: float = field(0.0001, unit="m", low=1e-6, high=0.01, doc="step of depth that the camera is asked for")
    silence: float = field(0.5, unit="s", low=0.1, high=10.0, doc="after which a camera is lost, and opened again")

    realtime_priority: int = field(
        25, low=0, high=98, doc="SCHED_FIFO priority if allowed, above the estimator's; 0: none"
    )

    def __post_init__(self) -> None:
        if self.left and self.left == self.right:
            raise ConfigError(f"left = right = '{self.left}': one camera cannot look into both bubbles")
