# SPDX-License-Identifier: Apache-2.0
"""A simulated identification: the cell with its hidden truth, and the procedures of seed_sysid in it."""
