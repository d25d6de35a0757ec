# SPDX-License-Identifier: Apache-2.0
"""Every number of a gel, in the world's units: one declaration for files, command lines and ROS parameters."""

from dataclasses import dataclass

from seed_core.config import field


@dataclass(frozen=True)
class GelSettings:
    """Defaults fit a gel 3 mm thin of which 19 x 14 mm are in view on 320 x 240 px."""

    distance: float = field(0.022, unit="m", low=0.002, high=0.2, doc="from the camera to the free gel")
    decimate: int = field(2, low=1, high=8, doc="slopes are computed on every n-th pixel and line, colours averaged")
    decay: float = field(0.0012, unit="m", low=1e-4, high=0.02, doc="way beside the tool over which imprint falls by e")

    dot: float = field(0.0006, unit="m", low=1e-4, high=0.005, doc="diameter of a dot")
    pitch: float = field(0.0021, unit="m", low=5e-4, high=0.02, doc="distance of dots")
    contrast: float = field(0.25, low=0.05, high=0.9, doc="by which a dot is darker than the coat")

    threshold: float = field(
        0.00012, unit="m", low=1e-5, high=0.005, doc="imprint from which a pixel may be in contact"
    )
    margin: float = field(
        0.0007, unit="m", low=0.0, high=0.01, doc="width cut off along the patch: its edge does not stick"
    )
    least_area: float = field(2e-6, unit="m^2", low=1e-8, high=1e-2, doc="from which a patch is a contact")
    least_dots: int = field(4, low=3, high=1000, doc="in the patch of a grasp")
    samples: int = field(400, low=50, high=20000, doc="places of the patch whose slope is followed")

    # standard deviations
    dot_std: float = field(1.5e-5, unit="m", low=1e-7, high=1e-3, doc="of a dot's place")
    slope_std: float = field(0.03, low=1e-4, high=1.0, doc="of a slope")
    depth_std: float = field(4e-5, unit="m", low=1e-7, high=1e-2, doc="of depth that is integrated from slopes")
    slope_area: float = field(4e-6, unit="m^2", low=1e-9, high=1e-3, doc="within which slopes err alike")
    off: float = field(1.5e-4, unit="m", low=1e-6, high=5e-3, doc="from which on a dot does not move with the tool")
