# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the controller, with unit, bound and meaning; the ROS parameters are declared from this."""

from dataclasses import dataclass

from seed_core.arm.limits import MotionLimits
from seed_core.config import field, inherited
from seed_core.vector3 import Vector3

# Every law by name; the classes behind them are `LAW_CLASSES` of controller.py.
LAWS = ("seed", "plain", "published")
LAW_HELP = "seed also predicts the surface ahead, plain does not, published is Algorithm 2 as in the paper"


# Limits that may be changed while the controller runs.
LIVE = (
    "max_force",
    "max_torque",
    "max_measured_force",
    "max_speed",
    "max_angular_speed",
    "approach_speed",
    "press_speed",
)


@dataclass(frozen=True)
class ControllerParameters(MotionLimits):
    """Parameters of `Controller`. The defaults are one set for every scenario."""

    law: str = field(
        "seed",
        choices=LAWS,
        doc="seed: HybridLaw with the surface observer; plain: the same without it; published: Algorithm 2 of "
        "the paper, hybrid by its partial inverses, no gravity, the stiffness map's model 'plain'",
    )
    rate: float = field(250.0, unit="Hz", low=50.0, high=1000.0, doc="how often step is called")
    # motion limits
    # Higher than the driver's own, which are for targets that nobody else limits: with those a wipe's force errs by a
    # sixth more, its path three times as much. Below the controller the driver is given room for them
    # (seed_bringup/config/driver.yaml). The box lies inside the driver's, so that no target is refused there. Force
    # control has no use for more than the bounds.
    max_speed: float = inherited(MotionLimits, "max_speed", 0.25, high=1.0)
    max_acceleration: float = inherited(MotionLimits, "max_acceleration", 2.0, low=0.05, high=20.0)
    max_jerk: float = inherited(MotionLimits, "max_jerk", 200.0, high=5000.0)
    max_angular_speed: float = inherited(MotionLimits, "max_angular_speed", 0.5, high=3.0)
    max_angular_acceleration: float = inherited(MotionLimits, "max_angular_acceleration", 6.0, low=0.1)
    max_angular_jerk: float = field(600.0, unit="rad/s^3", low=1.0, high=20000.0, doc="largest commanded angular jerk")
    workspace_low: Vector3 = inherited(MotionLimits, "workspace_low", (-1.3, -1.3, -0.2))
    workspace_high: Vector3 = inherited(MotionLimits, "workspace_high", (1.3, 1.3, 1.6))
    # contact
    approach_speed: float = field(0.03, unit="m/s", low=0.001, high=0.1, doc="towards contact")
    press_speed: float = field(
        0.045,
        unit="m/s",
        low=0.001,
        high=0.25,
        doc="building up the force, in contact; three times that for changing one that has been there",
    )
    max_free_travel: float = field(0.06, unit="m", low=0.005, high=0.5, doc="of an approach without contact")
    contact_share: float = field(0.3, low=0.05, high=0.9, doc="of the wanted force that counts as contact")
    lost_share: float = field(0.05, low=0.0, high=0.5, doc="of the wanted force below which contact is lost")
    contact_images: int = field(2, low=1, high=20, doc="images in a row that decide on contact")
    lost_images: int = field(9, low=1, high=100, doc="images in a row that decide on its loss")
    # limits on what may be asked and measured
    max_force: float = field(15.0, unit="N", low=0.1, high=200.0, doc="largest force that may be asked for")
    max_torque: float = field(2.0, unit="N m", low=0.01, high=20.0, doc="largest torque that may be asked for")
    max_measured_force: float = field(40.0, unit="N", low=1.0, high=500.0, doc="estimated force that makes it hold")
    max_excess_force: float = field(
        3.0, unit="N", low=0.5, high=100.0, doc="estimated force beyond what is wanted, in contact, that makes it hold"
    )
    max_unexpected_force: float = field(
        5.0, unit="N", low=0.5, high=100.0, doc="rise of the estimated force in a move without force that makes it hold"
    )
    max_jump: float = field(
        3.5, unit="N", low=0.5, high=100.0, doc="change of force between two images that no motion explains"
    )
    max_tracking_error: float = field(
        0.005, unit="m", low=0.001, high=0.1, doc="of the arm behind its command, beyond its lag, that makes it hold"
    )
    max_angular_tracking_error: float = field(
        0.05,
        unit="rad",
        low=0.01,
        high=3.0,
        doc="of the arm's turn behind its command, beyond its lag, that makes it hold",
    )
    max_deflection: float = field(0.03, unit="m", low=0.002, high=0.1, doc="of the grasp, against slip")
    max_rotation: float = field(30.0, unit="deg", low=2.0, high=60.0, doc="of the grasp, against slip")
    max_drift: float = field(
        20.0,
        unit="deg",
        low=1.0,
        high=90.0,
        doc="of torque-controlled axes from the reference, beyond max_rotation; the command is clamped",
    )
    friction: float = field(
        0.4, low=0.0, high=2.0, doc="of the tool on what it presses, against which the grasp must not tip"
    )
    # inputs
    estimate_timeout: float = field(0.14, unit="s", low=0.02, high=2.0, doc="longest gap between estimates")
    max_estimate_age: float = field(0.3, unit="s", low=0.02, high=2.0, doc="oldest image that is still used")
    kinematics_timeout: float = field(0.1, unit="s", low=0.01, high=1.0, doc="longest gap between flange poses")
    max_unloaded_force: float = field(
        1.0, unit="N", low=0.1, high=100.0, doc="that a tool may seem to press with in free air; more holds an approach"
    )
    max_stamp_error: float = field(
        0.07,
        unit="s",
        low=0.005,
        high=0.14,
        doc="of images' stamps, as the motion in contact shows it; more makes it hold",
    )
    stamp_warning: float = field(0.03, unit="s", low=0.005, high=0.14, doc="the same from which on it is told")
    setpoint_max_age: float = field(0.5, unit="s", low=0.02, high=60.0, doc="oldest stamp of a set-point when it comes")
    # filters and observer
    servo_lag: float = field(0.015, unit="s", low=0.0, high=0.5, doc="first guess of the arm's lag; then measured")
    force_filter: float = field(0.08, unit="s", low=0.0, high=2.0, doc="low-pass of the tip's place (plain law)")
    rotation_filter: float = field(
        0.1, unit="s", low=0.0, high=2.0, doc="low-pass of the tool's rotation at 0.5 deg of noise"
    )
    position_feedforward: float = field(0.12, unit="s", low=0.02, high=60.0, doc="least low-pass of the deflection")
    angle_feedforward: float = field(0.12, unit="s", low=0.02, high=60.0, doc="least time of a lean to come upright")
    feedforward_ratio: float = field(1.25, low=0.8, high=20.0, doc="of both to the time from image to answer, at least")
    max_lean_share: float = field(
        0.1,
        low=0.0,
        high=0.5,
        doc="of the grasp's turn that stays as lean, where the press could turn the softest axis",
    )
    side_stiffness: float = field(
        800.0,
        unit="N/m",
        low=50.0,
        high=1e5,
        doc="that a tip feels across its path, where a force turns the tool about a torque axis",
    )
    discrepancy_filter: float = field(
        0.15, unit="s", low=0.0, high=5.0, doc="low-pass of what the wrench model and its local stiffness differ by"
    )
    position_noise: float = field(0.3, unit="mm", low=0.001, high=10.0, doc="of an estimate that states no covariance")
    surface_noise: float = field(0.2, unit="mm/sqrt(s)", low=0.0, high=100.0, doc="random walk of the surface's height")
    slope_noise: float = field(0.002, unit="1/sqrt(s)", low=0.0, high=1.0, doc="random walk of the surface's slope")
    slope_prior: float = field(0.03, low=0.0, high=1.0, doc="standard deviation of the slope at first contact")
    compliance_prior: float = field(0.1, low=0.0, high=1.0, doc="standard deviation of the environment's share beta")
    moving_surface: float = field(
        0.02, low=0.0, high=0.5, doc="likelihood at first that the surface moves in time; 0: it never does"
    )
    stiffness_blend: float = field(0.5, unit="s", low=0.0, high=10.0, doc="time over which a new stiffness takes over")
