# SPDX-License-Identifier: Apache-2.0
"""Environments and builds that nothing uses any more: named, never deleted, for a run may still be in them."""

import json
from pathlib import Path

from progress import say


def name_unused(base: Path, environment: Path, root: Path) -> None:
    """Say which folders can go: of checkouts that are gone, and of earlier pins of this one. Their list is a file."""
    listed = base / "unused"
    listed.unlink(missing_ok=True)
    used, unused = {environment.name}, []
    for workspace in sorted(base.glob("ws-*")):
        if not (workspace / "stamp.json").is_file():
            return  # somebody is building
        checkout, env = _described(workspace)
        same_kind = env.rpartition("-")[0] == environment.name.rpartition("-")[0]
        outdated = checkout == root and same_kind and env != environment.name
        if outdated or not (checkout / "seed").is_file():
            unused.append(workspace)
        else:
            used.add(env)
    unused += [e for e in sorted(base.glob("env-*")) if (e / "seed-complete").is_file() and e.name not in used]
    if unused:
        listed.write_text("".join(f"{folder}\n" for folder in unused))
        say(f"{len(unused)} old folders are used no longer; to free their space: rm -r $(cat {listed})")


def _described(workspace: Path) -> tuple[Path, str]:
    """The checkout of a build and the name of its environment; nothing of use when the stamp is damaged."""
    try:
        stamp = json.loads((workspace / "stamp.json").read_text())
        return Path(stamp["checkout"]), Path(stamp["variables"]["VIRTUAL_ENV"]).name
    except (OSError, ValueError, KeyError):
        return Path("/nowhere"), ""
