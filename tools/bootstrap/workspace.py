# SPDX-License-Identifier: Apache-2.0
"""The colcon workspace of one checkout, and the variables that make it usable.

It lies beside the environment and sees the checkout through a link, so that white space in the checkout's path
reaches neither CMake nor script headers. Built once; again only for packages whose build files changed.
"""

import json
import os
import re
import shlex
import subprocess
from pathlib import Path
from typing import Any

import home
from environment import Environment
from progress import SetupError, run_logged
from ros import entries, foreign, lies_in
from unused import name_unused

# What a build reads by content, and where a new or removed file matters (contents are linked).
BUILD_FILES = ("package.xml", "setup.py", "setup.cfg", "CMakeLists.txt", "msg/*", "srv/*", "action/*")
LINKED_FILES = (*(f"{f}/**/*" for f in ("config", "launch", "rviz", "layouts", "urdf", "resource")), "*/__init__.py")
LISTS = (
    "AMENT_PREFIX_PATH",
    "CMAKE_PREFIX_PATH",
    "COLCON_PREFIX_PATH",
    "LD_LIBRARY_PATH",
    "PATH",
    "PKG_CONFIG_PATH",
    "PYTHONPATH",
)
KEPT = (*LISTS, "ROS_DISTRO", "ROS_VERSION", "ROS_PYTHON_VERSION", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "VIRTUAL_ENV")
BY_SEED = "SEED_LOOPBACK"  # tells the launch files whose the profile is
PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"  # of the Fast DDS in Jazzy
PROFILE_3 = "FASTDDS_DEFAULT_PROFILES_FILE"  # of Fast DDS 3, from Kilted on (rmw_fastrtps, pull request 806)
LOOPBACK = Path("seed_bringup") / "config" / "loopback.xml"  # nothing listens on another interface
DEFAULTS = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def ready_workspace(root: Path, environment: Environment, rebuild: list[str] | None) -> dict[str, str]:
    """The variables for a process in the built workspace; builds first what is out of date.

    rebuild: build every package, with these arguments for CMake.
    """
    key = home.digest(str(part).encode() for part in (root, environment.path, ":".join(environment.ros.underlays)))
    workspace = environment.path.parent / f"ws-{key}"
    workspace.mkdir(exist_ok=True)
    standins = [root / "tools" / "standins" / "tf2_msgs"] if environment.ros.prefix is None else []
    packages = sorted(p.parent for p in root.glob("seed_*/package.xml")) + standins
    wanted = {package.name: _digest(package) for package in packages}
    with home.locked(workspace / "lock", "the build") as lock:
        stamp = _read(workspace / "stamp.json")
        built = stamp.get("packages", {}) if rebuild is None else {}
        if built != wanted:
            changed = [name for name, value in wanted.items() if built.get(name) != value]
            paths = [package.relative_to(root) for package in packages]
            (workspace / "stamp.json").unlink(missing_ok=True)
            _build(root, workspace, environment, paths, changed, rebuild or [], lock)
            stamp = {"packages": wanted, "variables": _captured(workspace, environment), "checkout": str(root)}
            temporary = workspace / "stamp.json.new"
            temporary.write_text(json.dumps(stamp, indent=1))
            temporary.replace(workspace / "stamp.json")
            name_unused(workspace.parent, environment.path, root)
    return _merged(stamp["variables"], root, environment)


def _read(stamp: Path) -> dict[str, Any]:
    try:
        content = json.loads(stamp.read_text())
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _digest(package: Path) -> str:
    contents = [f for pattern in BUILD_FILES for f in sorted(package.glob(pattern)) if f.is_file()]
    listed = [f for pattern in LINKED_FILES for f in sorted(package.glob(pattern)) if f.is_file()]
    parts = [part for f in contents for part in (f.name.encode(), f.read_bytes())]
    return home.digest([*parts, *(str(f.relative_to(package)).encode() for f in listed)])


def _build(
    root: Path,
    workspace: Path,
    environment: Environment,
    packages: list[Path],
    changed: list[str],
    extra: list[str],
    lock: int,
) -> None:
    """Build the changed ones of the packages (paths from the root) with colcon."""
    link = workspace / "src"
    link.unlink(missing_ok=True)
    link.symlink_to(root, target_is_directory=True)
    command = [str(environment.python), "-m", "colcon", "--log-base", str(workspace / "log"), "build"]
    command += ["--symlink-install", "--build-base", str(workspace / "build")]
    command += ["--install-base", str(workspace / "install"), "--metas", str(link / "colcon.meta")]
    command += ["--base-paths", *(str(link / package) for package in packages), "--packages-select", *changed]
    command += ["--event-handlers", "console_direct+", "console_cohesion-"]
    command += ["--cmake-args", f"-DPython3_EXECUTABLE={environment.python}", "-DBUILD_TESTING=OFF", "-Wno-dev", *extra]
    variables = _sourced([], environment)  # the ROS 2 below us and nothing else of ours
    what = f"building {len(changed)} packages with colcon"
    run_logged(command, what, workspace / "build.log", variables, Packages(len(changed)).told, lock)


class Packages:
    """Which package is being built, of how many, out of what colcon and the compilers print."""

    def __init__(self, total: int) -> None:
        self._total, self._started, self._share = total, 0, ""
        self._under_way: list[str] = []

    def told(self, line: str) -> str:
        """The progress after this line: 'package 3 of 12: seed_msgs, 43 %'; '' before the first."""
        words = line.split()
        match words:
            case ["Starting", ">>>", name, *_]:
                self._under_way.append(name)
                self._started, self._share = self._started + 1, ""
            case [("Finished" | "Failed" | "Aborted"), "<<<", name, *_] if name in self._under_way:
                self._under_way.remove(name)
                self._share = ""
        if share := re.match(r"\[ *(\d+)%\]", line):
            self._share = f", {share[1]} %" if len(self._under_way) == 1 else ""  # of several nobody knows whose it is
        names = ", ".join(self._under_way)
        return f"package {self._started} of {self._total}: {names}{self._share}" if names else ""


def _captured(workspace: Path, environment: Environment) -> dict[str, str]:
    """What sourcing the workspace sets, kept so that later starts need no shell; nothing that the caller happened
    to have in a search path."""
    variables = _sourced([workspace / "install" / "local_setup.bash"], environment)
    ours = (environment.path, workspace, *filter(None, variables["AMENT_PREFIX_PATH"].split(":")))
    for name in LISTS:
        found = variables.get(name, "").split(":")
        variables[name] = ":".join(entry for entry in found if entry and lies_in(entry, *ours))
    return {name: variables[name] for name in KEPT if variables.get(name)}


def _sourced(scripts: list[Path], environment: Environment) -> dict[str, str]:
    """The variables of a bash that sources the ROS 2 and then the scripts."""
    ros = environment.ros
    dropped = (*LISTS, "SEED_ROOT", "ROS_DISTRO", "PYTHONHOME")
    start = {name: value for name, value in os.environ.items() if name not in dropped}
    path = [p for p in os.environ.get("PATH", os.defpath).split(":") if not foreign(p)]
    start["PATH"] = ":".join([str(environment.path / "bin"), *path])
    start["VIRTUAL_ENV"] = str(environment.path)
    if ros.prefix is None:
        start |= _wheels_variables(environment.path)
    elif ros.underlays:
        start |= {name: os.environ[name] for name in LISTS if name in os.environ and name != "PATH"}
    else:
        scripts = [ros.prefix / "setup.bash", *scripts]
    lines = [f"source {shlex.quote(str(script))} || exit 1" for script in scripts]
    command = ["bash", "--noprofile", "--norc", "-c", "\n".join([*lines, "exec env -0"])]
    done = subprocess.run(command, env=start, capture_output=True, text=True)
    if done.returncode != 0:
        raise SetupError(f"sourcing {' and '.join(map(str, scripts))} failed:\n{done.stderr.strip()}")
    return dict(item.split("=", 1) for item in done.stdout.split("\0") if "=" in item)


def _wheels_variables(path: Path) -> dict[str, str]:
    """The environment is an ament prefix, and its libraries are found by the loader."""
    libraries = [str(path / "lib"), *sorted(map(str, path.glob("lib/python3.*/site-packages/ros_*.libs")))]
    return {
        "AMENT_PREFIX_PATH": str(path),
        "CMAKE_PREFIX_PATH": str(path),
        "LD_LIBRARY_PATH": ":".join(libraries),
        "ROS_DISTRO": "jazzy",
        "ROS_VERSION": "2",
        "ROS_PYTHON_VERSION": "3",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
    }


def _merged(variables: dict[str, str], root: Path, environment: Environment) -> dict[str, str]:
    """The caller's variables with ours in front; with the wheels, without those of another ROS 2."""
    wheels = environment.ros.prefix is None
    result = DEFAULTS | dict(os.environ) | variables
    for name in variables.keys() & set(LISTS):
        ours = variables[name].split(":")
        theirs = [p for p in entries(name) if p not in ours and not (wheels and foreign(p))]
        result[name] = ":".join(ours + theirs)
    if wheels:
        result["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"
    bound = str(root / LOOPBACK)
    profile = PROFILE if result.get("ROS_DISTRO", "jazzy") == "jazzy" else PROFILE_3
    if result.get(profile) == bound:  # of a start around this one
        del result[profile]
    result.pop(BY_SEED, None)
    if profile not in result and result["ROS_AUTOMATIC_DISCOVERY_RANGE"] in ("LOCALHOST", "OFF"):
        result |= {profile: bound, BY_SEED: "true"}
    if not {"ROS_HOME", "ROS_LOG_DIR"} & result.keys() and home.why_not_writable(Path("~/.ros")):
        result["ROS_LOG_DIR"] = str(environment.path.parent / "log")  # nodes do not start without a place for logs
    result.pop("PYTHONHOME", None)
    # A start from within finds the same ROS 2 and pins again.
    return result | {
        "SEED_PINS": environment.pins,
        "SEED_ROS": "wheels" if wheels else str(environment.ros.prefix),
        "SEED_UNDERLAYS": ":".join(environment.ros.underlays),
        "SEED_ROOT": str(root),
    }
