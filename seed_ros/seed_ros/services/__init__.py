# SPDX-License-Identifier: Apache-2.0
"""Services that a node answers: its own, again until the client is met, and those that rclpy gives it."""
