# SPDX-License-Identifier: Apache-2.0
"""The errors that the suite raises on purpose: one base, and what tells a mistake of the user from a mishap."""


class SeedError(Exception):
    """What was asked for cannot be done; the message names the thing, the value, the unit, the bound and the remedy."""


class FailedError(SeedError):
    """What was asked for was sound, but it failed on the way: a node died, nobody answered, nothing could be found."""
