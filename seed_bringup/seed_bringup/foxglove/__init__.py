# SPDX-License-Identifier: Apache-2.0
"""A cell in Foxglove: the graph's messages as they are, over a WebSocket on loopback, and the operator's buttons.

command.py  the command
offered.py  which topics and buttons
schemas.py  their definitions
ros/        the node that forwards
"""
