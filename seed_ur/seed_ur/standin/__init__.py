# SPDX-License-Identifier: Apache-2.0
"""A stand-in for a UR controller: RTDE, script, dashboard and side ports on loopback (docs/ur_controller.md)."""
