# SPDX-License-Identifier: Apache-2.0
"""Simulated arm, grasp, tool, table and tactile cameras; evaluation in closed loop without ROS."""
