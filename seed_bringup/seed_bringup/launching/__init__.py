# SPDX-License-Identifier: Apache-2.0
"""Runs the XML launch files of the suite where `ros2 launch` is missing: read, resolve, start, supervise."""
