# SPDX-License-Identifier: Apache-2.0
"""System packages: found, installed when root, else named in one line to paste."""

import os
import shutil
import subprocess
from ctypes.util import find_library
from pathlib import Path

from progress import SetupError, say

OPTIONAL = {"usb-1.0": "libusb-1.0-0"}  # of RealSense cameras: library, and the package that brings it
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")  # as the tests look for one
BROWSER_PATIENCE = 180.0  # [s]
TOOLS = ("cmake", "make", "g++", "gcc")  # each in the package of its name
PROBE = """
import importlib.util as u, os, sys, sysconfig
print('%d.%d' % sys.version_info[:2], all(u.find_spec(m) for m in ('venv', 'ensurepip')),
      os.path.exists(os.path.join(sysconfig.get_path('include'), 'Python.h')))
"""


def require_system_packages(python: Path) -> None:
    """Compiler, CMake, the venv module and Python's headers."""
    _wish_for_optional_packages()
    missing = _missing(python)
    if not missing:
        return
    line = f"apt-get install -y {' '.join(missing)}"
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        raise SetupError(f"missing: {' '.join(missing)}. Install it with\n  sudo apt-get update && sudo {line}")
    say(f"missing here: {' '.join(missing)}; installing with apt-get")
    for arguments in (["update"], ["install", "-y", "--no-install-recommends", *missing]):
        command = ["apt-get", "-q", *arguments]
        env = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
        if subprocess.run(command, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL).returncode != 0:
            raise SetupError(f"failed: {' '.join(command)}. Run it by hand to see why")
    missing = _missing(python)
    if missing:
        raise SetupError(f"{line} went through, yet {' '.join(missing)} is still not usable with {python}")


def _wish_for_optional_packages() -> None:
    """What a few commands need, which say so themselves where it is missing: installed where that is easy."""
    missing = [package for library, package in OPTIONAL.items() if find_library(library) is None]
    if missing and os.geteuid() == 0 and shutil.which("apt-get"):
        for arguments in (["update"], ["install", "-y", "--no-install-recommends", *missing]):
            env = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
            quiet = subprocess.DEVNULL
            subprocess.run(["apt-get", "-q", *arguments], env=env, stdin=quiet, stdout=quiet, stderr=quiet)


def offer_browser() -> None:
    """A browser for the tests of the operator page, where that costs nobody a question: as root, with apt-get.

    Without one those tests are skipped and say so; nothing else needs it. SEED_BROWSER=none leaves the system alone.
    """
    if any(map(shutil.which, BROWSERS)) or os.environ.get("SEED_BROWSER") == "none":
        return
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        return
    say("no browser here for the tests of the operator page; installing chromium with apt-get (SEED_BROWSER=none: not)")
    env = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    for arguments in (["update"], ["install", "-y", "--no-install-recommends", "chromium"]):
        command = ["apt-get", "-q", *arguments]
        try:
            done = subprocess.run(
                command, env=env, stdin=subprocess.DEVNULL, capture_output=True, timeout=BROWSER_PATIENCE
            )
        except subprocess.TimeoutExpired:
            done = None
        if done is None or done.returncode != 0:
            say(f"could not: {' '.join(command)}; the tests of the page in a browser are skipped")
            return


def _missing(python: Path) -> list[str]:
    """Debian splits venv and headers off Python; other Pythons have both."""
    version, has_venv, has_headers = subprocess.check_output([str(python), "-I", "-c", PROBE], text=True).split()
    usable = {tool: shutil.which(tool) is not None for tool in TOOLS}
    usable |= {f"python{version}-venv": has_venv == "True", f"python{version}-dev": has_headers == "True"}
    return sorted(package for package, present in usable.items() if not present)
