# SPDX-License-Identifier: Apache-2.0
"""Messages to core values and back. Quaternions are x, y, z, w and covariances translation-first on this edge only."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseStamped, TransformStamped, WrenchStamped
from geometry_msgs.msg import Wrench as WrenchMsg
from seed_msgs.msg import MembraneMotion as MembraneMotionMsg
from seed_msgs.msg import RelativePose

from seed_core.arm.quaternion import Quaternion
from seed_core.errors import SeedError
from seed_core.estimate import DEFORMATIONS, MembraneMotion, RelativePoseEstimate
from seed_core.spatial import Array, Wrench, pose_from_quaternion, quaternion_from_rotation
from seed_core.vector3 import Vector3

_SWAP = [3, 4, 5, 0, 1, 2]  # rotation-first to translation-first and back


class MessageError(SeedError):
    """A message that cannot be used."""


def seconds(stamp: Time) -> float:
    """Time message as seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def stamp_from_seconds(t: float) -> Time:
    """Seconds as a time message."""
    whole = math.floor(t)
    nanosec = round((t - whole) * 1e9)
    return Time(sec=int(whole) + nanosec // 1_000_000_000, nanosec=nanosec % 1_000_000_000)


def pose_to_tuples(pose: Pose) -> tuple[Vector3, Quaternion]:
    """Position [m] and quaternion x, y, z, w of a Pose, unchecked."""
    p, q = pose.position, pose.orientation
    return (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)


def pose_to_matrix(pose: Pose, name: str = "pose") -> Array:
    """(4, 4) from a Pose. Raises SpatialError: not finite, or no unit quaternion."""
    p, q = pose_to_tuples(pose)
    return pose_from_quaternion(q, p, name)


def fill(message: Any, numbers: Iterable[float]) -> None:
    """Write x, y, z (and w) into a Point, Vector3 or Quaternion message."""
    for name, number in zip("xyzw", numbers, strict=False):
        setattr(message, name, float(number))


def fill_pose(pose: Pose, X: Array) -> Pose:
    """Write X (4, 4) into a Pose message."""
    fill(pose.position, X[:3, 3])
    fill(pose.orientation, quaternion_from_rotation(X[:3, :3]))
    return pose


def swap_halves(covariance: Array) -> Array:
    """(6, 6) covariance of (rotation, translation) or (torque, force) with the halves changed over, as messages are."""
    return covariance[np.ix_(_SWAP, _SWAP)]


def stamped(kind: Any, stamp: float | Time, frame_id: str) -> Any:
    """A message of a kind with a header; stamp: [s], or as a message."""
    message = kind()
    message.header.stamp = stamp if isinstance(stamp, Time) else stamp_from_seconds(stamp)
    message.header.frame_id = frame_id
    return message


def pose_stamped(X: Array, t: float, frame_id: str) -> PoseStamped:
    """PoseStamped of X (4, 4) at time t [s]."""
    message = stamped(PoseStamped, t, frame_id)
    fill_pose(message.pose, X)
    return message


def transform_stamped(X_AB: Array, t: float, frame_a: str, frame_b: str) -> TransformStamped:
    """TransformStamped of X_AB (4, 4) at time t [s]."""
    message = stamped(TransformStamped, t, frame_a)
    message.child_frame_id = frame_b
    fill(message.transform.translation, X_AB[:3, 3])
    fill(message.transform.rotation, quaternion_from_rotation(X_AB[:3, :3]))
    return message


def wrench_to_core(message: WrenchMsg, name: str = "wrench") -> Wrench:
    """Core wrench (torque, force) from a Wrench message. Raises MessageError: a value is not finite."""
    torque = np.array((message.torque.x, message.torque.y, message.torque.z))
    force = np.array((message.force.x, message.force.y, message.force.z))
    if not (np.isfinite(torque).all() and np.isfinite(force).all()):
        raise MessageError(f"{name} has a value that is not finite: force {force} N, torque {torque} N m")
    return Wrench(torque, force)


def fill_wrench(message: WrenchMsg, wrench: Wrench) -> WrenchMsg:
    """Write a core wrench into a Wrench message."""
    fill(message.force, wrench.force)
    fill(message.torque, wrench.torque)
    return message


def wrench_stamped(wrench: Wrench, t: float, frame_id: str) -> WrenchStamped:
    """WrenchStamped of a core wrench at time t [s]."""
    message = stamped(WrenchStamped, t, frame_id)
    fill_wrench(message.wrench, wrench)
    return message


def estimate_to_message(estimate: RelativePoseEstimate, frame_c: str, frame_t: str) -> RelativePose:
    """RelativePose message of an estimate."""
    message = stamped(RelativePose, estimate.stamp, frame_c)
    message.child_frame_id = frame_t
    fill_pose(message.pose.pose, estimate.X_CT)
    message.pose.covariance = swap_halves(estimate.covariance).ravel()
    fill_pose(message.slid.pose, estimate.X_PT)
    message.slid.covariance = swap_halves(estimate.covariance_PT).ravel()
    message.observed = [bool(o) for o in estimate.observed]
    message.valid = bool(estimate.valid)
    message.reason = estimate.reason
    message.slip = float(estimate.slip)
    message.gross_slip = bool(estimate.gross_slip)
    message.method = estimate.method
    message.membrane = [_motion_to_message(m) for m in estimate.membrane]
    return message


def _observed(message: RelativePose | MembraneMotionMsg) -> tuple[bool, bool, bool, bool, bool, bool]:
    x, y, z, roll, pitch, yaw = map(bool, message.observed)
    return x, y, z, roll, pitch, yaw


def _motion_to_message(motion: MembraneMotion) -> MembraneMotionMsg:
    message = MembraneMotionMsg(finger=motion.finger)
    fill_pose(message.motion.pose, motion.X_CM)
    message.motion.covariance = swap_halves(motion.covariance).ravel()
    message.observed = [bool(o) for o in motion.observed]
    message.deformation = motion.deformation.tolist()
    fill(message.centroid, motion.centroid)
    for name in ("area", "indentation", "pressure"):
        setattr(message, name, float(getattr(motion, name)))
    return message


def _motion_from_message(message: MembraneMotionMsg) -> MembraneMotion:
    covariance = np.asarray(message.motion.covariance, dtype=float).reshape(6, 6)
    deformation = np.asarray(message.deformation, dtype=float)
    if not (np.isfinite(covariance).all() and np.isfinite(deformation).all()):
        raise MessageError("relative_pose.membrane has a value that is not finite")
    if deformation.size not in (0, DEFORMATIONS):
        raise MessageError(
            f"relative_pose.membrane.deformation has {deformation.size} values; {DEFORMATIONS} or none are wanted"
        )
    c = message.centroid
    return MembraneMotion(
        finger=message.finger,
        X_CM=pose_to_matrix(message.motion.pose, "relative_pose.membrane"),
        covariance=swap_halves(covariance),
        observed=_observed(message),
        deformation=deformation,
        area=float(message.area),
        centroid=np.array((c.x, c.y, c.z)),
        indentation=float(message.indentation),
        pressure=float(message.pressure),
    )


def estimate_from_message(message: RelativePose) -> RelativePoseEstimate:
    """The core's estimate of a RelativePose message.

    Raises:
        SpatialError, MessageError: a value is not finite, or the quaternion is no unit quaternion.
    """
    covariance = np.asarray(message.pose.covariance, dtype=float).reshape(6, 6)
    slid = np.asarray(message.slid.covariance, dtype=float).reshape(6, 6)
    if message.valid and not np.isfinite(covariance).all():
        raise MessageError("relative_pose.covariance has a value that is not finite")
    if message.valid and not np.isfinite(slid).all():
        raise MessageError("relative_pose.slid.covariance has a value that is not finite")
    if not math.isfinite(message.slip):
        raise MessageError(f"relative_pose.slip = {message.slip} is not finite")
    X_CT = pose_to_matrix(message.pose.pose, "relative_pose") if message.valid else np.eye(4)
    return RelativePoseEstimate(
        stamp=seconds(message.header.stamp),
        X_CT=X_CT,
        covariance=swap_halves(covariance),
        observed=_observed(message),
        valid=bool(message.valid),
        reason=message.reason,
        slip=float(message.slip),
        gross_slip=bool(message.gross_slip),
        method=message.method,
        membrane=tuple(_motion_from_message(m) for m in message.membrane) if message.valid else (),
        X_PT=pose_to_matrix(message.slid.pose, "relative_pose.slid") if message.valid else np.eye(4),
        covariance_PT=swap_halves(slid),
    )


def check_frame(frame_id: str, known: tuple[str, ...], name: str) -> None:
    """Raises MessageError when a message's frame is none of the known ones."""
    if frame_id not in known:
        raise MessageError(f"{name}.header.frame_id = '{frame_id}' is unknown here; known: {', '.join(known)}")


def check_not_ahead(stamp: float, now: float, most: float, name: str) -> None:
    """Raises MessageError when a stamp is more than `most` [s] ahead of now: nothing could ever be newer."""
    if stamp - now > most:
        raise MessageError(
            f"{name} is stamped {stamp - now:.3f} s ahead of this computer's clock (at most {most:g} s): "
            "set both clocks by one source"
        )
