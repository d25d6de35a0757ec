# SPDX-License-Identifier: Apache-2.0
"""What cameras see without any network: the simulated truth goes from one namespace to the other by a socket of files.

python -m seed_testing.two_hosts.ros.world send SOCKET
python -m seed_testing.two_hosts.ros.world receive SOCKET SKEW TOPIC PERIOD
"""

import contextlib
import socket
import struct
import sys
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import qos_profile_sensor_data
from seed_msgs.msg import RelativePose
from sensor_msgs.msg import TimeReference

from seed_ros.qos import COMMAND

STAMP = struct.Struct("<iI")  # of a header, behind the four bytes that say how a message is serialized
AT = 4
TRUTH = "sim/ground_truth/relative_pose"


def send(file: str) -> None:
    """Every truth of this namespace goes into the socket."""
    node, out = rclpy.create_node("world_out"), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)

    def on(message: bytes) -> None:
        with contextlib.suppress(OSError):  # nobody looks yet
            out.sendto(message, file)

    node.create_subscription(RelativePose, TRUTH, on, qos_profile_sensor_data, raw=True)
    rclpy.spin(node)


def receive(file: str, skew: float, topic: str, period: float) -> None:
    """What comes is published, by a clock that is ahead by skew [s], at most once in a period [s].

    In place of an estimator it also says what time it is here.
    """
    node, into = rclpy.create_node("world_in"), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    into.bind(file)
    into.settimeout(0.005)
    out, next_at = node.create_publisher(RelativePose, topic, COMMAND), 0.0
    if topic == "relative_pose":
        answers = node.create_publisher(TimeReference, "clock_answer", COMMAND)

        def answer(question: TimeReference) -> None:
            reply = TimeReference(time_ref=question.header.stamp)
            reply.header.stamp.sec, reply.header.stamp.nanosec = divmod(time.time_ns() + round(1e9 * skew), 10**9)
            answers.publish(reply)

        node.create_subscription(TimeReference, "clock_question", answer, COMMAND)
    while rclpy.ok():
        with contextlib.suppress(TimeoutError):
            message = bytearray(into.recv(65536))
            if time.monotonic() >= next_at:
                next_at = max(next_at + period, time.monotonic() - period)
                sec, nanosec = STAMP.unpack_from(message, AT)
                STAMP.pack_into(message, AT, *divmod(sec * 10**9 + nanosec + round(1e9 * skew), 10**9))
                out.publish(bytes(message))
        rclpy.spin_once(node, timeout_sec=0.0)


def main() -> None:
    """Command line."""
    rclpy.init(args=[])
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        if sys.argv[1] == "send":
            send(sys.argv[2])
        else:
            receive(sys.argv[2], float(sys.argv[3]), sys.argv[4], float(sys.argv[5]))


if __name__ == "__main__":
    main()
