# SPDX-License-Identifier: Apache-2.0
"""Set-point messages to the core's set-points, and the core's state to a ControllerState message."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion
from seed_msgs.msg import ControllerState as StateMsg
from seed_msgs.msg import HybridSetpoint as HybridMsg
from seed_msgs.msg import RelativePoseSetpoint as RelativePoseMsg
from seed_msgs.msg import WrenchSetpoint as WrenchMsg

from seed_control.setpoint.setpoints import (
    AxisFlags,
    HybridSetpoint,
    RelativePoseSetpoint,
    SetpointError,
    WrenchSetpoint,
)
from seed_control.state import ControllerState
from seed_core.hand import Tool
from seed_core.spatial import Array, Wrench, pose_from_quaternion, so3_log
from seed_ros.conversions import check_frame, fill_pose, fill_wrench, pose_to_matrix, seconds, wrench_to_core
from seed_ros.frames import FrameNames

_IGNORED = ("estimates_invalid", "estimates_out_of_order", "estimates_unmatched")


def hybrid_setpoint(message: HybridMsg, frames: FrameNames) -> HybridSetpoint:
    """Raises SeedError: a value is not finite, no unit quaternion, an unknown frame, or a contradiction."""
    check_frame(message.header.frame_id, (frames.base,), "setpoint")
    frame = message.task_frame or HybridMsg.TASK_FRAME_WORLD
    R = _task_orientation(message.task_orientation)
    if frame == HybridMsg.TASK_FRAME_TOOL and np.abs(R - np.eye(3)).max() > 1e-6:
        raise SetpointError(
            "SP01", "task_orientation is for task_frame 'surface' or 'found'; 'tool' has the axes of the tip frame"
        )
    return HybridSetpoint(
        X_W_tip=pose_to_matrix(message.pose, "setpoint.pose"),
        wrench=wrench_to_core(message.wrench, "setpoint.wrench"),
        force_projector=np.array(message.force_projector, dtype=float).reshape(3, 3),
        torque_axes=_flags(message.torque_axes),
        task_frame=frame,
        R_W_task=R,
        contact_resists=_flags(message.contact_resists),
        velocity=np.array((message.velocity.x, message.velocity.y, message.velocity.z)),
        stamp=_stamp(message.header.stamp),
    )


def wrench_setpoint(message: WrenchMsg, frames: FrameNames, tool: Tool) -> WrenchSetpoint:
    """Raises SeedError as hybrid_setpoint does. A wrench in the axes of T is turned into those of the tip frame."""
    check_frame(message.header.frame_id, (frames.base, frames.tool, frames.tip), "wrench_setpoint")
    wrench, in_world = wrench_to_core(message.wrench, "wrench_setpoint.wrench"), message.header.frame_id == frames.base
    if message.header.frame_id == frames.tool:
        wrench = wrench.rotated(tool.X_Ttip[:3, :3].T)
    return WrenchSetpoint(
        wrench, "world" if in_world else "tool", _flags(message.contact_resists), _stamp(message.header.stamp)
    )


def relative_pose_setpoint(message: RelativePoseMsg, frames: FrameNames) -> RelativePoseSetpoint:
    """Raises SeedError as hybrid_setpoint does."""
    check_frame(message.header.frame_id, (frames.tool,), "relative_pose_setpoint")
    if message.child_frame_id not in ("", frames.compliance):
        raise SetpointError(
            "SP01", f"relative_pose_setpoint.child_frame_id = '{message.child_frame_id}'; known: {frames.compliance}"
        )
    return RelativePoseSetpoint(
        pose_to_matrix(message.pose, "relative_pose_setpoint.pose"), _stamp(message.header.stamp)
    )


def fill_state(
    message: StateMsg, state: ControllerState, setpoint: HybridSetpoint | None, error: Wrench | None
) -> StateMsg:
    """Everything but the header and the counts of the node itself; error: `PublishedLaw.regulated_error`."""
    message.enabled, message.mode, message.reason = state.enabled, state.mode, state.reason
    message.setpoint_kind, message.in_contact, message.settled = state.setpoint_kind, state.in_contact, state.settled
    fill_wrench(message.desired, state.desired or Wrench.zero())
    fill_wrench(message.estimated, state.estimated or Wrench.zero())
    fill_wrench(message.deviation, state.deviation or Wrench.zero())
    fill_wrench(message.error, error or Wrench.zero())
    if setpoint is not None and state.X_W_tip is not None:
        message.lean = so3_log(setpoint.X_W_tip[:3, :3].T @ state.X_W_tip[:3, :3])
    if state.X_W_tip is not None:
        fill_pose(message.tip, state.X_W_tip)
    if state.measured_X_CT is not None:
        fill_pose(message.displacement, state.measured_X_CT)
    message.limits_hit = list(state.limits_hit)
    message.contradictions = list(state.contradictions)
    message.estimate_age = state.image_age if np.isfinite(state.image_age) else float("nan")
    message.refused_setpoints = state.counters.setpoints_refused
    message.ignored_estimates = sum(getattr(state.counters, name) for name in _IGNORED)
    message.ignored_poses = state.counters.kinematics_refused
    return message


def _task_orientation(q: Quaternion) -> Array:
    values = (q.x, q.y, q.z, q.w)
    if not any(values) or values == (0.0, 0.0, 0.0, 1.0):
        return np.eye(3)
    return pose_from_quaternion(values, (0.0, 0.0, 0.0), "setpoint.task")[:3, :3]


def _flags(values: object) -> AxisFlags:
    a, b, c = (bool(v) for v in values)  # type: ignore[attr-defined]
    return a, b, c


def _stamp(stamp: Time) -> float | None:
    """None for the zero stamp, which means: now."""
    return seconds(stamp) or None
