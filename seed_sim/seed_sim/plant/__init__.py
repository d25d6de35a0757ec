# SPDX-License-Identifier: Apache-2.0
"""The simulated cell in Drake: arm, soft grasp, tool, table and what stands on it."""
