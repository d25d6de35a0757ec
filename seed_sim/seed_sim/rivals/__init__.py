# SPDX-License-Identifier: Apache-2.0
"""What people use instead: force laws for rigid grippers and wrist sensors, each with its documented limits."""
