# SPDX-License-Identifier: Apache-2.0
"""Finds installed packages and their executables along AMENT_PREFIX_PATH."""

from __future__ import annotations

import os
from pathlib import Path

from seed_bringup.launching.elements import LaunchError


def package_prefix(package: str) -> Path:
    """The install prefix of a package."""
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if p]
    for prefix in prefixes:
        if (Path(prefix) / "share" / "ament_index" / "resource_index" / "packages" / package).exists():
            return Path(prefix)
    raise LaunchError(
        f"package {package!r} is not installed here (looked along AMENT_PREFIX_PATH: {len(prefixes)} places)"
    )


def package_share(package: str) -> Path:
    """The share folder of a package."""
    return package_prefix(package) / "share" / package


def executable(package: str, name: str) -> Path:
    """The path of a package's executable."""
    folder = package_prefix(package) / "lib" / package
    path = folder / name
    if path.is_file() and os.access(path, os.X_OK):
        return path
    there = sorted(f.name for f in folder.glob("*") if f.is_file() and os.access(f, os.X_OK))
    raise LaunchError(f"package {package!r} has no executable {name!r}; it has: {', '.join(there) or 'none'}")


def find_launch_file(words: list[str]) -> Path:
    """PACKAGE FILE, a path, or the name of a launch file of seed_bringup with or without its ending."""
    if len(words) == 2:
        return _in_package(words[0], words[1])
    path = Path(words[0])
    if path.is_file():
        return path
    if path.suffix == ".xml" and len(path.parts) > 1:
        raise LaunchError(f"{path}: no such file")
    return _in_package("seed_bringup", words[0])


def _in_package(package: str, name: str) -> Path:
    folder = package_share(package) / "launch"
    for candidate in (name, f"{name}_launch.xml", f"{name}.xml", f"{name}.launch.xml"):
        if (folder / candidate).is_file():
            return folder / candidate
    there = sorted(f.name for f in folder.glob("*.xml"))
    raise LaunchError(f"package {package!r} has no launch file {name!r}; it has: {', '.join(there) or 'none'}")
