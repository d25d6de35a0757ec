# SPDX-License-Identifier: Apache-2.0
"""What each enclave may do: a policy file in the format of SROS 2 (version 0.2.0), read."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from seed_core.errors import SeedError

VERSION = "0.2.0"
RIGHTS = {  # tag: what may be done to what it names
    "topics": ("publish", "subscribe"),
    "services": ("reply", "request"),
    "actions": ("execute", "call"),
}
GLOBAL = ("/diagnostics", "/rosout", "/parameter_events")  # of all cells, whatever their namespaces


@dataclass(frozen=True)
class Right:
    """One thing that an enclave may do: publish, subscribe, reply, request, execute or call; name: absolute."""

    does: str
    name: str


def read_policy(file: Path, namespace: str = "") -> dict[str, tuple[Right, ...]]:
    """Rights of each enclave, by its path; names are put into the namespace.

    Raises:
        SeedError: the file is no policy.
    """
    try:
        root = ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise SeedError(f"{file}: no policy can be read: {error}") from error
    if root.tag != "policy" or root.get("version") != VERSION:
        raise SeedError(f"{file}: the outermost tag must be <policy version='{VERSION}'>")
    found = {}
    for enclave in root.iter("enclave"):
        path = enclave.get("path", "")
        if not path.startswith("/") or path in found:
            raise SeedError(f"{file}: enclave path '{path}' must begin with / and stand there once")
        found[path] = tuple(_rights(enclave, file, namespace.strip("/")))
    return found


def _rights(enclave: ElementTree.Element, file: Path, namespace: str) -> Iterator[Right]:
    for tag, kinds in RIGHTS.items():
        for group in enclave.iter(tag):
            for does in (kind for kind in kinds if kind in group.keys()):  # noqa: SIM118
                if group.get(does) != "ALLOW":
                    raise SeedError(f"{file}: {does}='{group.get(does)}': only ALLOW is taken; the rest is denied")
                for one in group:
                    name = (one.text or "").strip()
                    if not name.startswith("/"):
                        raise SeedError(f"{file}: '{name}' must be an absolute name")
                    yield Right(does, f"/{namespace}{name}" if namespace and name not in GLOBAL else name)
