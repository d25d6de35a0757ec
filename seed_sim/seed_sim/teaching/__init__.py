# SPDX-License-Identifier: Apache-2.0
"""Demonstrations to the simulated cell, taught and played again: how far the replay is from what was shown."""
