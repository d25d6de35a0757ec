# SPDX-License-Identifier: Apache-2.0
"""UR arms without ROS: kinematics, models, the RTDE codec, and a stand-in controller."""
