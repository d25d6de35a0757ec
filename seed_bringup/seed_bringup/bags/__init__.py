# SPDX-License-Identifier: Apache-2.0
"""Bags in MCAP: recorded, played and described, with or without the `ros2` command."""

from seed_core.errors import SeedError


class BagError(SeedError):
    """A bag cannot be written or read; the message says which and why."""
