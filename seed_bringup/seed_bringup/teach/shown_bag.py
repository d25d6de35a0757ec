# SPDX-License-Identifier: Apache-2.0
"""What a bag shows."""

from pathlib import Path

from seed_bringup.bags import BagError
from seed_bringup.bags.files import check_versions, open_bag, read_messages
from seed_bringup.bags.types import InstalledTypes
from seed_bringup.teach.heard import STATE, WRENCH, Heard


def heard_in(path: Path, namespace: str = "", led: bool = False) -> Heard:
    """The messages of a bag; led: as `Heard` has it.

    Raises:
        BagError: no readable bag, of another version, or without what is needed.
    """
    root = f"/{namespace.strip('/')}/".replace("//", "/")
    names = {root + name: name for name in (STATE, WRENCH)}
    with open_bag(path) as reader:
        chosen = [c for c in reader.connections if c.topic in names]
        if missing := [t for t in names if t not in {c.topic for c in chosen}]:
            raise BagError(f"{path} lacks {', '.join(missing)}: record with ./seed bag record --all")
        check_versions(path, chosen, InstalledTypes())
    heard = Heard(led)
    for topic, _, message in read_messages(path, lambda topic: topic in names):
        heard.take(names[topic], message)
    return heard
