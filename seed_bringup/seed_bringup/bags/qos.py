# SPDX-License-Identifier: Apache-2.0
"""Quality of service between rclpy and bags."""

from collections.abc import Sequence

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

PLAY_DEPTH = 100
# The strictest profile that every present publisher of a topic satisfies.
TO_RECORD = QoSProfile(
    depth=200, reliability=ReliabilityPolicy.BEST_AVAILABLE, durability=DurabilityPolicy.BEST_AVAILABLE
)


def for_bag(profile: QoSProfile) -> Qos:
    """A publisher's profile as a bag stores it."""
    return Qos(
        history=QosHistory[profile.history.name],
        depth=profile.depth,
        reliability=QosReliability[profile.reliability.name],
        durability=QosDurability[profile.durability.name],
        deadline=_time(profile.deadline),
        lifespan=_time(profile.lifespan),
        liveliness=QosLiveliness[profile.liveliness.name],
        liveliness_lease_duration=_time(profile.liveliness_lease_duration),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def _time(duration: Duration) -> QosTime:
    return QosTime(*divmod(duration.nanoseconds, 10**9))


def to_play(recorded: Sequence[Qos], messages: int) -> QoSProfile:
    """A profile that serves every subscriber the recorded publishers served; latched topics keep what they said."""
    reliable = not recorded or any(q.reliability != QosReliability.BEST_EFFORT for q in recorded)
    latched = any(q.durability == QosDurability.TRANSIENT_LOCAL for q in recorded)
    depth = max((q.depth for q in recorded), default=0)
    kept = depth or min(max(messages, 1), PLAY_DEPTH)
    return QoSProfile(
        depth=kept if latched else max(depth, PLAY_DEPTH),
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
