# SPDX-License-Identifier: Apache-2.0
"""Which cell a command speaks to: its ROS domain and its namespace."""

import argparse
import os

from seed_bringup.launching.domains import VARIABLE, running
from seed_core.errors import SeedError


def cell_arguments(parser: argparse.ArgumentParser) -> None:
    """The options that name a cell."""
    parser.add_argument("--namespace", default="", help="of the cell, as given to its launch; without it: none")
    parser.add_argument(
        "--domain", type=int, help=f"of the cell; default: {VARIABLE}, else that of the one that runs on this machine"
    )


def in_root(namespace: str) -> str:
    """A namespace with its slash."""
    return "/" + namespace.strip("/")


def join(options: argparse.Namespace) -> None:
    """Set the domain of the cell that is meant, before ROS is started.

    Raises:
        SeedError: none is named and several run.
    """
    if options.domain is not None:
        os.environ[VARIABLE] = str(options.domain)
    if os.environ.get(VARIABLE):
        return
    cells = running()
    if len(cells) > 1:
        there = "; ".join(f"--domain {domain}: {what}" for domain, what in cells.items())
        raise SeedError(f"several cells run on this machine, say which: {there}")
    if cells:
        os.environ[VARIABLE] = str(next(iter(cells)))
