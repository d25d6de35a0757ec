# SPDX-License-Identifier: Apache-2.0
"""Helpers at the ROS edge: conversions, parameters, TF, images, diagnostics."""
