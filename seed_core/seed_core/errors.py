# SPDX-License-Identifier: Apache-2.0
"""The errors that the suite raises on purpose: one base, and what tells a mistake of the user from a mishap."""


class SeedError(Exception):
    """What was asked for cannot be done; the message names the thing, the value, the unit, the bound and the remedy."""


def os_error_words(error: OSError) -> str:
    """What an error of the system is about, and what it is, without its number."""
    return f"{error.filename}: {error.strerror or error}" if error.filename else error.strerror or str(error)


class FailedError(SeedError):
    """What was asked for was sound, but it failed on the way: a node died, nobody answered, nothing could be found."""
