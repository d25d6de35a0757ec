# SPDX-License-Identifier: Apache-2.0
"""Bags in MCAP: recorded, played and described, with or without the `ros2` command."""
