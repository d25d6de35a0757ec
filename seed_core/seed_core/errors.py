# SPDX-License-Identifier: Apache-2.0
"""The one base of every error that the suite raises on purpose."""


class SeedError(Exception):
    """What was asked for cannot be done; the message names the thing, the value, the unit, the bound and the remedy."""
