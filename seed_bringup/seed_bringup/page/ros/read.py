# SPDX-License-Identifier: Apache-2.0
"""From the newest message of each topic to what the page shows; live and from a bag alike."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from math import nan
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from seed_msgs.msg import ContactPatches, ControllerState, RelativePose, WrenchEstimate
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Float32, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker

from seed_bringup.page.state import CellState, ControlView, DepthView, GraspView, WrenchView
from seed_core.errors import SeedError
from seed_core.hand import FINGERS, Tool
from seed_core.meshes import Mesh
from seed_core.spatial import Array, pose_from_quaternion
from seed_ros import COMMAND, LATCHED, SENSOR
from seed_ros.conversions import pose_to_matrix, seconds
from seed_ros.images.arrays import depth_from_message, gray_from_message
from seed_ros.images.cameras import IMAGES, INFO, intrinsics
from seed_ros.images.serialized import read_image
from seed_ur.models import JOINT_NAMES

DEBUG = "estimator/debug_image"
STATE = "controller/state"
NEWEST = QoSProfile(depth=1)  # of a reliable stream


# Who says why the arm holds, and what the page calls that arm where it has no better name.
HOLDS = {
    "driver/hold_reason": "behind the driver",
    "guard/hold_reason": "one of your own, behind the guard",
    "sim/hold_reason": "simulated",
}


class Topic(NamedTuple):
    """raw: kept as bytes until it is shown."""

    kind: Any
    qos: QoSProfile
    raw: bool = False


TOPICS: Mapping[str, Topic] = {
    "current_pose": Topic(PoseStamped, NEWEST),
    "relative_pose": Topic(RelativePose, COMMAND),
    "wrench_estimate": Topic(WrenchEstimate, COMMAND),
    "contact_patches": Topic(ContactPatches, COMMAND),
    "joint_states": Topic(JointState, NEWEST),
    STATE: Topic(ControllerState, NEWEST),
    "controller/ready": Topic(DiagnosticStatus, LATCHED),
    **{topic: Topic(String, LATCHED) for topic in HOLDS},
    "sim/real_time_factor": Topic(Float32, NEWEST),
    "sim/ground_truth/table_pose": Topic(PoseStamped, LATCHED),
    "sim/ground_truth/table": Topic(Marker, LATCHED),
    "/tf_static": Topic(TFMessage, LATCHED),
    DEBUG: Topic(Image, SENSOR, raw=True),
    **{f"bubble_{f}/{IMAGES['depth']}": Topic(Image, SENSOR, raw=True) for f in FINGERS},
    **{f"bubble_{f}/{IMAGES['ir']}": Topic(Image, SENSOR, raw=True) for f in FINGERS},
    **{f"bubble_{f}/{INFO}": Topic(CameraInfo, SENSOR) for f in FINGERS},
}
PICTURES = frozenset(name for name, topic in TOPICS.items() if topic.raw)


def read_state(
    newest: Mapping[str, Any],
    fixed: Mapping[tuple[str, str], Array],
    silent: float = 0.0,
    tool: Tool | None = None,
    arm: str = "",
) -> CellState:
    """What the page shows of these messages, by topic; what cannot be read is left out.

    Args:
        newest: messages, raw ones as bytes.
        fixed: poses of the fixed frames.
        silent: [s] since the last message.
        tool: what is held.
        arm: what its driver calls it.
    """
    telling = [newest[STATE]] if STATE in newest else [m for m in newest.values() if hasattr(m, "header")]
    now = max((seconds(m.header.stamp) for m in telling), default=nan)
    state: dict[str, Any] = {"now": now, "fixed": fixed, "silent": silent, "tool": tool}
    for name, topic, read in (
        ("X_WE", "current_pose", lambda m: pose_to_matrix(m.pose)),
        ("X_WS", "sim/ground_truth/table_pose", lambda m: pose_to_matrix(m.pose)),
        ("table", "sim/ground_truth/table", _TABLE.of),
        ("joints", "joint_states", _joints),
        ("control", STATE, _control),
        ("grasp", "relative_pose", _grasp),
        ("touch", "wrench_estimate", _touch),
        ("contact", "contact_patches", lambda m: {p.finger: p.area for p in m.patches if p.in_contact}),
        ("missing", "controller/ready", lambda m: {v.key: v.value for v in m.values if v.value}),
        ("real_time_factor", "sim/real_time_factor", lambda m: float(m.data)),
    ):
        if topic in newest:
            with suppress(SeedError, ValueError):
                state[name] = read(newest[topic])
    state["arm_holds"] = next(filter(None, (newest[t].data for t in HOLDS if t in newest)), "")
    state["arm"] = arm or next((name for t, name in HOLDS.items() if t in newest), "")
    state["depths"] = dict(_depths(newest))
    with suppress(SeedError, ValueError):
        state["picture"] = _picture(newest)
    return CellState(**state)


def fixed_frames(message: Any) -> Iterator[tuple[tuple[str, str], Array]]:
    """Pose of each frame in its parent, of a TFMessage."""
    for t in message.transforms:
        p, q = t.transform.translation, t.transform.rotation
        with suppress(SeedError):
            X = pose_from_quaternion((q.x, q.y, q.z, q.w), (p.x, p.y, p.z))
            yield (t.header.frame_id, t.child_frame_id), X


def _six(wrench: Any) -> Array:
    f, m = wrench.force, wrench.torque
    return np.array((f.x, f.y, f.z, m.x, m.y, m.z))


def _joints(message: Any) -> Array:
    angles = dict(zip(message.name, message.position, strict=False))
    ends = [[a for n, a in angles.items() if n.endswith(name)] for name in JOINT_NAMES]
    q = np.array([found[0] for found in ends if found], float)
    if q.shape != (6,) or not np.isfinite(q).all():
        raise ValueError("joint_states are not those of this arm")
    return q


class TableShape:
    """The table's mesh of a marker; worked out once for each message."""

    def __init__(self) -> None:
        self._message: Any = None
        self._mesh: Mesh | None = None

    def of(self, marker: Any) -> Mesh:
        """Raises ValueError: no triangles with finite corners."""
        if marker is not self._message or self._mesh is None:
            corners = np.array([(p.x, p.y, p.z) for p in marker.points], float).reshape(-1, 3)
            if not len(corners) or len(corners) % 3 or not np.isfinite(corners).all():
                raise ValueError("the table's marker holds no triangles")
            vertices, index = np.unique(corners, axis=0, return_inverse=True)
            self._message, self._mesh = marker, Mesh(vertices, index.reshape(-1, 3).astype(np.int32))
        return self._mesh


_TABLE = TableShape()


def _control(m: Any) -> ControlView:
    return ControlView(
        seconds(m.header.stamp), m.enabled, m.mode, m.reason, m.in_contact, m.settled,
        _six(m.desired), _six(m.estimated), _six(m.deviation),
    )  # fmt: skip


def _grasp(m: Any) -> GraspView:
    return GraspView(pose_to_matrix(m.pose.pose), m.valid, m.reason, float(m.slip), m.gross_slip)


def _touch(m: Any) -> WrenchView:
    six = _six(m.wrench)
    return WrenchView(six[:3], six[3:], np.array(m.covariance, float).reshape(6, 6), m.reason)


def _depths(newest: Mapping[str, Any]) -> Iterator[tuple[str, DepthView]]:
    """Each membrane as its camera sees it; what little a lens distorts is not seen in a picture of the cell."""
    for finger in FINGERS:
        depth, info = newest.get(f"bubble_{finger}/{IMAGES['depth']}"), newest.get(f"bubble_{finger}/{INFO}")
        if depth is None or info is None:
            continue
        with suppress(SeedError, ValueError):
            k = intrinsics(info, rectified=False).k
            yield finger, DepthView(depth_from_message(read_image(depth)), (k[0], k[4], k[2], k[5]))


def _picture(newest: Mapping[str, Any]) -> NDArray[np.uint8] | None:
    """Both tactile images (H, W, 3) RGB: the estimator's, or, where that has none yet, the cameras'."""
    if DEBUG in newest:
        image = read_image(newest[DEBUG])
        if image.encoding == "bgr8" and len(image.data) == image.step * image.height:
            rows = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, : 3 * image.width]
            if rows.any():
                return np.ascontiguousarray(rows.reshape(image.height, image.width, 3)[..., ::-1])
    topics = (f"bubble_{f}/{IMAGES['ir']}" for f in FINGERS)
    raw = [gray_from_message(read_image(newest[t])) for t in topics if t in newest]
    if not raw or len({r.shape for r in raw}) > 1:
        return None
    both = np.concatenate(raw, axis=1)
    top = max(float(np.percentile(both[::4, ::4], 99.5)), 1.0)
    return np.repeat(np.clip(255.0 / top * both, 0.0, 255.0).astype(np.uint8)[..., None], 3, axis=-1)
