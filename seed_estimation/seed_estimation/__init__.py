# SPDX-License-Identifier: Apache-2.0
"""Pose of the grasped tool and contact patches from two tactile cameras."""
