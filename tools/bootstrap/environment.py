# SPDX-License-Identifier: Apache-2.0
"""The Python environment: one per set of pins, interpreter and ROS 2, shared by all checkouts of a user."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import home
from progress import SetupError, UsageError, run_logged, say
from ros import Ros, find_ros
from system import require_system_packages

PINNED_NUMPY_1 = ("jazzy", "kilted")  # ROS 2 on Ubuntu 24.04


class Environment(NamedTuple):
    """A finished environment: where it is, which ROS 2 it serves, with which set of pins."""

    path: Path
    ros: Ros
    pins: str

    @property
    def python(self) -> Path:
        """Its interpreter."""
        return self.path / "bin" / "python"


def ready_environment(root: Path, pins: str) -> Environment:
    """The environment for this checkout's pins, made first if it is not there."""
    ros = find_ros()
    pins = pins or os.environ.get("SEED_PINS") or ("apt" if ros.kind in PINNED_NUMPY_1 else "wheels")
    if pins not in ("wheels", "apt"):
        raise UsageError(f"SEED_PINS={pins}: must be wheels (NumPy 2) or apt (NumPy 1.26)")
    python = _interpreter(ros)
    names = ["build", "common", pins, "dev", *(["ros-wheels"] if ros.prefix is None else [])]
    files = [root / "requirements" / f"{name}.txt" for name in names]
    identity = [*(f.read_bytes() for f in files), *(str(v).encode() for v in (python, ros.kind, ros.prefix))]
    base = home.seed_home()
    environment = Environment(base / f"env-{ros.kind}-{pins}-{home.digest(identity)}", ros, pins)
    complete = environment.path / "seed-complete"
    with home.locked(base / f"{environment.path.name}.lock", "the environment") as lock:
        if not (complete.is_file() and environment.python.exists()):
            _make(environment, python, files, lock)
            complete.touch()
    return environment


def _interpreter(ros: Ros) -> Path:
    """ROS from apt brings its own Python; the wheels take the one that runs this."""
    if ros.python is None:
        return Path(os.path.realpath(sys.executable))
    found = Path(f"/usr/bin/python{ros.python[0]}.{ros.python[1]}")
    if not found.exists():
        raise SetupError(f"the ROS 2 at {ros.prefix} needs {found}, which is missing; or choose SEED_ROS=wheels")
    return found


def _make(environment: Environment, python: Path, files: list[Path], lock: int) -> None:
    """From nothing, for half an environment of an interrupted set-up is not worth trusting."""
    require_system_packages(python)
    if environment.path.exists():
        say("an earlier set-up did not finish; starting the environment over")
        shutil.rmtree(environment.path)
    prefix = environment.ros.prefix
    name = "the ROS 2 wheels" if prefix is None else f"the ROS 2 at {prefix}"
    say(f"setting up {environment.path} with {name} (1.5 GB; some minutes, once)")
    flags = [] if prefix is None else ["--system-site-packages"]
    subprocess.run([str(python), "-I", "-m", "venv", *flags, str(environment.path)], check=True, pass_fds=(lock,))
    _install(environment, files, lock)
    if prefix is None:
        _repair_exported_cmake(environment)


def _install(environment: Environment, files: list[Path], lock: int) -> None:
    """Every distribution is pinned, so pip resolves nothing; setuptools first, for the one that has no wheel."""
    pip = [str(environment.python), "-I", "-m", "pip", "install", "--no-deps", "--no-input"]
    pip += ["--disable-pip-version-check", "--progress-bar", "off", "--only-binary", ":all:"]
    cache = os.environ.get("PIP_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    if home.why_not_writable(Path(cache)):
        pip += ["--no-cache-dir"]
    pins = [line for f in files for line in f.read_text().splitlines() if line.strip() and line[0] not in "#-"]
    first = [line.split()[0] for line in pins if line.startswith("setuptools==")]
    everything = [argument for f in files if f.name != "common.txt" for argument in ("-r", str(f))]
    seen = 0

    def shorten(line: str) -> str:
        nonlocal seen
        if line.startswith("Collecting "):
            seen += 1
            return f"{seen} of {len(pins)}: {line.split()[1]}"
        return line.strip()[:90] if line.startswith("Installing") else ""

    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH")}
    env["_ROS_WHEELS_BOOTSTRAP_COMPLETE"] = "1"  # the wheels' bootstrapper would start every Python twice
    logs = environment.path
    run_logged([*pip, *first], "installing setuptools", logs / "install-first.log", env, lambda _: "", lock)
    command = [*pip, "--no-binary", "empy", "--no-build-isolation", *everything]
    run_logged(command, "installing packages", logs / "install.log", env, shorten, lock)


def _repair_exported_cmake(environment: Environment) -> None:
    """The wheels' CMake exports name folders of the machine that built them; point them at this interpreter."""
    query = "import numpy, sysconfig; print(sysconfig.get_path('include')); print(numpy.get_include())"
    env = os.environ | {"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"}
    output = subprocess.check_output([str(environment.python), "-I", "-c", query], text=True, env=env)
    include, numpy_include = output.splitlines()
    for file in environment.path.glob("share/*/cmake/*.cmake"):
        text = file.read_text()
        fixed = re.sub(r'/opt/python/[^;"]*/numpy/(_core|core)/include', numpy_include, text)
        fixed = re.sub(r'/opt/python/[^;"]*/include/python3\.\d+', include, fixed)
        if fixed != text:
            file.write_text(fixed)
