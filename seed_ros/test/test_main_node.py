# SPDX-License-Identifier: Apache-2.0
"""A node ends quietly however often it is interrupted."""

import signal
import subprocess
import sys
import time

NODE = """
import sys
from rclpy.node import Node
from std_msgs.msg import String
from seed_ros.node import run

def create():
    node = Node("interrupted")
    node.streams = [node.create_publisher(String, f"stream_{i}", 10) for i in range(30)]
    node.create_timer(0.01, lambda: print("spinning", flush=True))
    return node

sys.exit(run(create))
"""


def test_a_node_interrupted_again_while_it_ends_ends_without_a_trace():
    process = subprocess.Popen([sys.executable, "-c", NODE], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "spinning\n"
    for _ in range(40):  # `ros2 launch` sends one of its own after the terminal's
        process.send_signal(signal.SIGINT)
        time.sleep(0.005)
    _, errors = process.communicate(timeout=10.0)
    assert (process.returncode, errors) == (0, "")


def test_a_parameter_file_that_cannot_be_read_is_named_without_a_trace(tmp_path):
    file = tmp_path / "parameters.yaml"
    file.write_text("/**:\n  ros__parameters:\n    max_speed: [1\n")
    command = [sys.executable, "-c", NODE, "--ros-args", "--params-file", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30.0)
    assert done.returncode == 1
    (line,) = (line for line in done.stderr.splitlines() if not line.startswith("[ERROR]"))  # rcl has its own
    assert line.startswith("error: ")
    assert str(file) in line
