# SPDX-License-Identifier: Apache-2.0
"""The qualities of service that the suite uses."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# Images and other streams where the newest value is what counts.
SENSOR = QoSProfile(depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)
# Commands and estimates: the newest must arrive.
COMMAND = QoSProfile(depth=1)
# What a late joiner needs.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Set-points and poses of which each one counts.
QUEUE = QoSProfile(depth=20)
# Moving transforms, as tf2_ros has them.
TF = QoSProfile(depth=100)
# Simulated time.
CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
