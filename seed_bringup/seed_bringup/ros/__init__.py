# SPDX-License-Identifier: Apache-2.0
"""What needs ROS of the commands: a session with a running cell, captures, and the frames of the arm's links."""
