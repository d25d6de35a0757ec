# SPDX-License-Identifier: Apache-2.0
"""A task in closed loop without ROS and without a clock: run, score, sweep, and the baselines SEED is compared with."""
