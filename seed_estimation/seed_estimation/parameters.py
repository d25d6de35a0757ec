# SPDX-License-Identifier: Apache-2.0
"""Every number that the estimator can be told: one declaration for files, command lines and ROS parameters."""

from dataclasses import dataclass

from seed_core.config import ConfigError, field

# Every method by name; those that work on the contact patches have their classes in `PATCH_METHODS` of estimator.py.
METHODS = ("rigid_fit", "published")
METHOD_HELP = (
    "rigid_fit fits one motion of six axes to all images, published is the paper's: patches, and the flow's curl"
)
REFERENCE_LATER, GRASP_LATER = "from the next reference on", "from the next grasp on"
REST_LATER = "in the reference from the next one on"


@dataclass(frozen=True)
class EstimatorParameters:
    """Defaults fit a PicoFlexx inside a soft bubble; config/ has those for a RealSense D405.

    Lengths in pixels are meant for an image about 224 px wide: use `decimate` for larger ones.
    """

    method: str = field(
        "rigid_fit", choices=METHODS, doc="which estimator gives relative_pose; a change ends the grasp"
    )
    calibration: str = field(
        "", doc="file written by ./seed calibrate; without it the hand's drawing and raw range; counts from the start"
    )
    decimate: int = field(1, low=1, high=8, doc="use every n-th pixel and line; a change ends reference and grasp")

    # What says so in its help waits for a new reference or grasp; all else changes with the next images.
    # what counts as membrane
    near: float = field(0.050, unit="m", low=0.01, high=1.0, doc=f"nothing closer is membrane; {REST_LATER}")
    far: float = field(0.120, unit="m", low=0.02, high=2.0, doc=f"nothing further away is membrane; {REST_LATER}")
    steady: float = field(
        0.0025, unit="m", low=1e-5, high=0.05, doc=f"largest deviation of a pixel during reference; {REFERENCE_LATER}"
    )
    rim: int = field(7, unit="px", low=0, high=50, doc=f"width cut off along the membrane's rim; {REFERENCE_LATER}")
    least_valid: float = field(0.15, low=0.01, high=1.0, doc="share of a depth image that must lie in near to far")
    saturation: float = field(65535.0, unit="counts", low=100.0, high=65535.0, doc="infrared value of a full pixel")

    # what counts as contact
    threshold: float = field(0.0015, unit="m", low=1e-4, high=0.02, doc="indentation from which a pixel is in contact")
    largest: float = field(0.020, unit="m", low=0.002, high=0.1, doc="a larger indentation is a broken pixel")
    smooth: int = field(5, unit="px", low=1, high=25, doc="side of the box over which indentation is averaged")
    opening: int = field(
        7, unit="px", low=1, high=31, doc="diameter of the ellipse that opens the patch: what is narrower is none"
    )
    least_area: int = field(150, unit="px", low=4, high=100000, doc="pixels from which a patch is a contact")

    loaded_grasp: str = field(
        "correct",
        choices=("correct", "refuse", "ignore"),
        doc="a grasp that is taken while the tool hangs or is pressed: count deflections from where it would be free, "
        "refuse it, or count from where it is",
    )
    max_drag: float = field(0.006, unit="m", low=0.0005, high=0.02, doc="of such a grasp's patches; more is refused")

    # rigid fit
    core: float = field(
        0.65, low=0.0, high=0.95, doc=f"share of the deepest indentation from which a pixel is followed; {GRASP_LATER}"
    )
    erosion: int = field(
        3, unit="px", low=0, high=40, doc=f"width cut off along the patch: its edge does not stick; {GRASP_LATER}"
    )
    image_points: int = field(500, low=100, high=20000, doc=f"infrared pixels followed per finger; {GRASP_LATER}")
    depth_points: int = field(300, low=100, high=20000, doc=f"depth pixels followed per finger; {GRASP_LATER}")
    decay: float = field(
        0.0085, unit="m", low=0.001, high=0.1, doc=f"way beside the tool over which imprint falls by e; {GRASP_LATER}"
    )
    iterations: int = field(8, low=1, high=50, doc="most Gauss-Newton steps of one frame")
    lock: float = field(
        0.75, low=0.1, high=0.999, doc="share of the image explained by the motion below which it is lost"
    )
    learn_slip: bool = field(True, doc="estimate the share of motion that the membrane does not follow")
    max_slip: float = field(0.5, low=0.0, high=0.9, doc="largest micro-slip that is corrected")

    # published method
    curl_gain: float = field(1.0, low=0.05, high=10.0, doc="pitch over the mean curl: see published.fitted_gain")
    flow_window: int = field(50, unit="px", low=5, high=101, doc="Farneback's window")

    # time and trust
    max_skew: float = field(0.025, unit="s", low=0.0, high=1.0, doc="largest difference of the two fingers' stamps")
    max_gap: float = field(0.5, unit="s", low=0.01, high=60.0, doc="longer gaps between images lose the track")
    max_std_translation: float = field(0.001, unit="m", low=1e-5, high=0.1, doc="beyond it an axis is not observed")
    max_std_rotation: float = field(0.035, unit="rad", low=1e-4, high=1.0, doc="beyond it an axis is not observed")

    # what the cameras may get wrong all the time: standard deviations, which enter the covariance
    mount_rotation_std: float = field(0.0065, unit="rad", low=0.0, high=0.2, doc="of a camera's mount, about each axis")
    mount_position_std: float = field(0.0004, unit="m", low=0.0, high=0.02, doc="of a camera's mount, along each axis")
    focal_std: float = field(0.006, low=0.0, high=0.2, doc="of the focal length, as a share of it")
    depth_scale_std: float = field(0.006, low=0.0, high=0.2, doc="of the scale of depth, as a share of it")
    depth_offset_std: float = field(0.0002, unit="m", low=0.0, high=0.02, doc="of depth and of the membrane's shape")
    finger_skew_std: float = field(
        0.01,
        unit="s",
        low=0.0,
        high=0.1,
        doc=f"of one finger's images behind the other's, beyond stamps; 0: not learnt; {GRASP_LATER}",
    )
    depth_lag_std: float = field(
        0.02,
        unit="s",
        low=0.0,
        high=0.2,
        doc=f"of depth behind infrared, which some cameras filter; 0: not learnt; {GRASP_LATER}",
    )

    def __post_init__(self) -> None:
        if not self.near < self.far:
            raise ConfigError(f"near = {self.near:g} m must be less than far = {self.far:g} m")
        if not self.threshold < self.largest:
            raise ConfigError(f"threshold = {self.threshold:g} m must be less than largest = {self.largest:g} m")
