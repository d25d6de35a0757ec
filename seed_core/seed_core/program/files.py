# SPDX-License-Identifier: Apache-2.0
"""Files that are installed beside a package's code: configuration, tasks, scenarios."""

from importlib.util import find_spec
from pathlib import Path

from seed_core.errors import SeedError


def shared_path(package: str, relative: str) -> Path:
    """A file or folder of a package: in its source tree, or in the share folder of where it is installed.

    Args:
        package: import name, which is also the name of the ROS package.
        relative: path below the package's root, such as "config/tasks".

    Raises:
        SeedError: the package is not installed, or lacks the file.
    """
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise SeedError(f"the package {package} is not installed: build the workspace again")
    code = Path(spec.origin).resolve().parent
    for base in (code.parent, *(parent / "share" / package for parent in code.parents)):
        if (base / relative).exists():
            return base / relative
    raise SeedError(f"{package}/{relative} is not installed: build the workspace again")
