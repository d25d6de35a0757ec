# SPDX-License-Identifier: Apache-2.0
"""Every number of the tactile renderer. Measured values have their source in docs/tactile_simulation.md."""

from dataclasses import dataclass

from seed_core.config import ConfigError, field
from seed_core.hand import FINGERS_OF

CAMERAS = ("picoflexx", "d405")
SHAPES = ("cylinder", "short_handle", "box", "marker")


@dataclass(frozen=True)
class ToolShape:
    """The held part of the tool, centred on T, with its axis along z_T."""

    kind: str = field("cylinder", choices=SHAPES, doc="box has flat faces; the others are round about z_T")
    radius: float = field(
        0.012, unit="m", low=0.003, high=0.03, doc="of round shapes; half thickness along y_T of a box"
    )
    length: float = field(0.2, unit="m", low=0.01, high=1.0, doc="along z_T")
    width: float = field(0.03, unit="m", low=0.005, high=0.2, doc="of a box, along x_T")

    @property
    def round(self) -> bool:
        """Whether turning about z_T leaves the surface as it is."""
        return self.kind != "box"


HANDLE = ToolShape(kind="box", radius=0.012, width=0.03, length=0.06)  # of a tool that is pressed: its sides are flat


@dataclass(frozen=True)
class TactileParameters:
    """What is held, how the membrane gives way, and how the camera errs."""

    camera: str = field("picoflexx", choices=CAMERAS, doc="camera inside each bubble")
    fingers: str = field("both", choices=tuple(FINGERS_OF), doc="which cameras deliver images")
    tool: ToolShape = field(ToolShape(), doc="what is held")
    squeeze: float = field(
        0.0065, unit="m", low=0.0005, high=0.015, doc="imprint of the tool in each bubble at the grasp"
    )

    # membrane
    rim_x: float = field(0.057, unit="m", low=0.01, high=0.2, doc="semi-axis of the rim along x_C")
    rim_z: float = field(0.040, unit="m", low=0.01, high=0.2, doc="semi-axis of the rim along z_C")
    height: float = field(0.030, unit="m", low=0.005, high=0.1, doc="of the dome over its rim")
    decay: float = field(0.0085, unit="m", low=0.001, high=0.05, doc="distance over which an imprint decays by e")
    bulge: float = field(1.0, low=0.0, high=1.5, doc="share of the displaced volume that bulges out elsewhere")
    lag: float = field(0.35, low=0.0, high=1.0, doc="share of the tool's motion by which the patch's outline lags")
    peel: float = field(0.35, low=0.0, high=1.0, doc="share of its displacement that material loses off the tool")
    slip: float = field(0.0, low=0.0, high=0.9, doc="micro-slip: share of the motion that the membrane does not follow")
    hold: float = field(
        0.0, unit="m", low=0.0, high=0.05, doc="sideways displacement from which the tool slides; 0: it never does"
    )
    kinetic: float = field(0.75, low=0.1, high=1.0, doc="share of `hold` that is left while the tool slides")

    # what the infrared image shows
    dot_pitch: float = field(0.0039, unit="m", low=0.001, high=0.02, doc="mean distance of rows of printed dots")
    dot_jitter: float = field(0.24, low=0.0, high=0.5, doc="deviation of a dot from its grid, in pitches")
    dot_radius: float = field(0.00045, unit="m", low=1e-4, high=0.003, doc="deviation of the blot's Gaussian profile")
    dot_contrast: tuple[float, float] = field(
        (0.38, 0.72), low=0.0, high=0.95, doc="least and largest contrast of a dot"
    )
    brightness: float = field(0.15, low=0.0, high=1.0, doc="how much brighter the patch is in contact")
    brightness_change: float = field(0.0, low=-0.5, high=1.0, doc="further swing of the patch's brightness in 7 s")
    specular: float = field(2895.0, unit="counts", low=0.0, high=65535.0, doc="peak of the specular spot")
    specular_at: tuple[float, float] = field((0.947, 0.503), low=0.0, high=1.0, doc="its place in widths and heights")

    # how the camera errs
    noise: float = field(1.0, low=0.0, high=20.0, doc="scale of all noise that changes between frames")
    pattern: float = field(1.0, low=0.0, high=20.0, doc="scale of the fixed pattern in depth and of the dots' dipoles")
    range_offset: float = field(
        0.0, low=0.0, high=3.0, doc="scale of the smooth range error; 1 is an uncalibrated camera"
    )
    dropouts: float = field(1.0, low=0.0, high=20.0, doc="scale of the rate of missing depth inside the membrane")
    memory: float = field(
        0.0, low=0.0, high=0.95, doc="share of its depth that a D405 takes from the frame before: its temporal filter"
    )
    quantum: float = field(0.0001, unit="m", low=0.0, high=0.005, doc="step of the depth of a D405")

    def __post_init__(self) -> None:
        if self.dot_contrast[0] > self.dot_contrast[1]:
            raise ConfigError(f"dot_contrast = {self.dot_contrast} must rise from the least to the largest")
        if self.squeeze >= self.height:
            raise ConfigError(f"squeeze = {self.squeeze:g} m must be less than the dome's height {self.height:g} m")
