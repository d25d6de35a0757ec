# SPDX-License-Identifier: Apache-2.0
"""Campaigns in closed loop over many draws: commands with arguments of their own."""
