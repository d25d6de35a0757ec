# SPDX-License-Identifier: Apache-2.0
"""Finds installed packages, their executables and their launch files along AMENT_PREFIX_PATH."""

import os
from contextlib import suppress
from pathlib import Path

from seed_bringup.launching.launch_xml import LaunchError
from seed_core.program.suggestions import did_you_mean


def package_prefix(package: str) -> Path:
    """The install prefix of a package."""
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if p]
    for prefix in prefixes:
        if Path(prefix, "share/ament_index/resource_index/packages", package).exists():
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
    programs = {f.name: f for f in sorted(folder.glob("*")) if f.is_file() and os.access(f, os.X_OK)}
    if name not in programs:
        raise LaunchError(f"package {package!r} has no executable {name!r}; it has: {', '.join(programs) or 'none'}")
    return programs[name]


def _is_launch_file(word: str) -> bool:
    """Whether a word names no package, but a launch file by itself."""
    with suppress(LaunchError):
        package_prefix(word)
        return False
    with suppress(LaunchError):
        return find_launch_file([word]).is_file()
    return False


def find_launch_file(words: list[str]) -> Path:
    """PACKAGE FILE, a path, or the name of a launch file of seed_bringup with or without its ending."""
    package, name = words if len(words) == 2 else ("seed_bringup", words[0])
    if len(words) == 2 and _is_launch_file(package):
        raise LaunchError(f"{name}: no argument of {package}: arguments have the form name:=value")
    if len(words) == 1 and Path(name).is_file():
        return Path(name)
    if len(words) == 1 and name.endswith(".xml") and len(Path(name).parts) > 1:
        raise LaunchError(f"{name}: no such file")
    folder = package_share(package) / "launch"
    for candidate in (name, f"{name}_launch.xml", f"{name}.xml", f"{name}.launch.xml"):
        if (folder / candidate).is_file():
            return folder / candidate
    there = sorted(f.name for f in folder.glob("*.xml"))
    meant = did_you_mean(name, (t.removesuffix("_launch.xml") for t in there))
    raise LaunchError(f"package {package!r} has no launch file {name!r}; it has: {', '.join(there) or 'none'}{meant}")
