# SPDX-License-Identifier: Apache-2.0
"""A gripper with rate, latency and force limit, and grasps that are pulled at."""
