# SPDX-License-Identifier: Apache-2.0
"""System packages: found, installed when root, else named in one line to paste."""

import os
import shutil
import subprocess
from pathlib import Path

from progress import SetupError, say

TOOLS = {"cmake": "cmake", "make": "make", "g++": "g++", "gcc": "gcc"}


def require_system_packages(python: Path) -> None:
    """Compiler, CMake, the venv module and Python's headers."""
    missing = _missing(python)
    if not missing:
        return
    line = f"apt-get install -y {' '.join(missing)}"
    if os.geteuid() == 0 and shutil.which("apt-get"):
        say(f"missing here: {' '.join(missing)}; installing with apt-get")
        _apt(["update"])
        _apt(["install", "-y", "--no-install-recommends", *missing])
        missing = _missing(python)
        if not missing:
            return
        raise SetupError(f"{line} went through, yet {' '.join(missing)} is still not usable with {python}")
    raise SetupError(f"missing: {' '.join(missing)}. Install it with\n  sudo apt-get update && sudo {line}")


def _missing(python: Path) -> list[str]:
    names = {package for tool, package in TOOLS.items() if shutil.which(tool) is None}
    return sorted(names | _missing_of_python(python))


def _missing_of_python(python: Path) -> set[str]:
    """Debian splits venv and headers off Python; other Pythons have both."""
    probe = (
        "import sys, sysconfig, os, importlib.util as u; v = '%d.%d' % sys.version_info[:2];"
        "print(v, all(u.find_spec(m) for m in ('venv', 'ensurepip')),"
        " os.path.exists(os.path.join(sysconfig.get_path('include'), 'Python.h')))"
    )
    version, has_venv, has_headers = subprocess.check_output([str(python), "-I", "-c", probe], text=True).split()
    wanted = {f"python{version}-venv": has_venv, f"python{version}-dev": has_headers}
    return {package for package, present in wanted.items() if present != "True"}


def _apt(arguments: list[str]) -> None:
    env = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    command = ["apt-get", "-q", *arguments]
    if subprocess.run(command, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL).returncode != 0:
        raise SetupError(f"failed: {' '.join(command)}. Run it by hand to see why")
