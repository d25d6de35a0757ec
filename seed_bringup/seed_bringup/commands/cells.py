# SPDX-License-Identifier: Apache-2.0
"""Which cell a command speaks to: its ROS domain and its namespace."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from seed_bringup.launching.domains import VARIABLE, age, running
from seed_core.errors import SeedError
from seed_core.program.command_line import whole
from seed_core.program.suggestions import nearest

if TYPE_CHECKING:
    from seed_bringup.ros.session import Session

STARTING = 20.0  # [s] after its launch that a cell may take until its nodes are seen
MEET = 1.5  # [s] until the nodes of a cell that runs already are seen, as a rule
LIKE = 0.75  # of 1, from which one name may have been meant by another
HIGHEST = 232  # domain of DDS: the next would have ports above 65535
TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")  # of a namespace, as ROS takes it


def cell_arguments(parser: argparse.ArgumentParser) -> None:
    """The options that name a cell."""
    namespace_argument(parser)
    domain_argument(parser)


def namespace_argument(parser: argparse.ArgumentParser) -> None:
    """The option that names a cell's namespace: without slashes at its ends."""
    parser.add_argument(
        "--namespace", type=_namespace, default="", help="of the cell, as given to its launch; without it: none"
    )


def domain_argument(parser: argparse.ArgumentParser) -> None:
    """The option that names a cell's domain."""
    parser.add_argument(
        "--domain",
        type=whole(0, HIGHEST),
        help=f"of the cell; default: {VARIABLE}, else that of the one that runs on this machine",
    )


def _namespace(text: str) -> str:
    try:
        return check_namespace(text)
    except SeedError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def check_namespace(text: str) -> str:
    """A namespace without slashes at its ends. Raises SeedError: ROS has none of that name."""
    name = text.strip("/")
    if name and not all(TOKEN.fullmatch(token) for token in name.split("/")):
        raise SeedError(
            f"{text!r} must be names with / between them, each of letters, digits and _ and not beginning with a digit"
        )
    return name


def in_root(namespace: str) -> str:
    """A namespace with its slash."""
    return f"/{namespace}"


def missing(problem: str, name: str, known: Iterable[str], listing: str) -> str:
    """A name that the cell does not have: what may have been meant instead, and the command that lists all."""
    names = sorted(known, key=lambda k: (-k.count("/"), k))
    if not names:
        return f"{problem}: no cell is running in ROS domain {os.environ.get(VARIABLE, 0)}"
    ends = {_last(k): k for k in names}  # of several with one last name that of the fewest namespaces
    close = nearest(name, names, LIKE) or ends.get(nearest(_last(name), ends, LIKE), "")
    return f"{problem}; {f'did you mean {close[1:]}? ' if close else ''}{listing} lists what there is"


def _last(name: str) -> str:
    return name.rpartition("/")[2]


def await_start(session: Session, there: Callable[[], bool], command: str) -> None:
    """Where the cell has just been launched, wait until what is asked of it is there, and say so."""
    named = os.environ.get(VARIABLE, "")
    left = STARTING - age(int(named)) if named.isdigit() else 0.0
    if left > 0.0:
        session.until(there, min(MEET, left), "")
        if not there():
            print(f"{command}: waiting for the cell to start", file=sys.stderr, flush=True)
            session.until(there, left, "")


def join(options: argparse.Namespace) -> str:
    """Set the domain of the cell that is meant, before ROS is started; which one it is and why, in words.

    Raises:
        SeedError: none is named and several run.
    """
    if options.domain is not None:
        os.environ[VARIABLE] = str(options.domain)
    if named := os.environ.get(VARIABLE):
        here = _words(running().get(int(named), ())) if named.isdigit() else ""
        why = f"as {VARIABLE if options.domain is None else '--domain'} says"
        return f"ROS domain {named}, {why}" + (f" ({here})" if here else "")
    cells = running()
    if len(cells) > 1:
        there = "; ".join(f"--domain {domain}: {_words(what)}" for domain, what in cells.items())
        raise SeedError(f"you run several cells on this machine, say which: {there}")
    for domain, what in cells.items():
        os.environ[VARIABLE] = str(domain)
        only = "the only cell that you run" if len(what) == 1 else "the only one in which you run cells"
        return f"ROS domain {domain}, {only} on this machine ({_words(what)})"
    return "ROS domain 0, the default: you run no cell on this machine"


def _words(cells: Iterable[str]) -> str:
    return ", ".join(f"seed {what}" for what in cells)
