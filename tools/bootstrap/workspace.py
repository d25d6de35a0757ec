# SPDX-License-Identifier: Apache-2.0
"""The colcon workspace of one checkout, and the variables that make it usable.

It lies beside the environment and sees the checkout through a link, so that white space in the checkout's path
reaches neither CMake nor script headers. Built once; again only for packages whose build files changed.
"""

import json
import os
import shlex
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import home
from environment import Environment
from leftovers import name_leftovers
from progress import SetupError, run_logged
from ros import foreign

# What a build reads by content, and where a new or removed file matters (contents are linked).
BUILD_FILES = ("package.xml", "setup.py", "setup.cfg", "CMakeLists.txt", "msg/*", "srv/*", "action/*")
LINKED_FOLDERS = ("config", "launch", "rviz", "layouts", "urdf", "resource", "*/__init__.py")
LISTS = (
    "AMENT_PREFIX_PATH",
    "CMAKE_PREFIX_PATH",
    "COLCON_PREFIX_PATH",
    "LD_LIBRARY_PATH",
    "PATH",
    "PKG_CONFIG_PATH",
    "PYTHONPATH",
)
DEFAULTS = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
}


def ready_workspace(root: Path, environment: Environment, force: bool, extra: list[str]) -> dict[str, str]:
    """The variables for a process in the built workspace; builds first what is out of date."""
    key = home.digest(
        [str(root).encode(), str(environment.path).encode(), ":".join(environment.ros.underlays).encode()]
    )
    workspace = environment.path.parent / f"ws-{key}"
    wanted = _digests(root, environment)
    stamp = _read(workspace / "stamp.json")
    if force or stamp.get("packages") != wanted:
        workspace.mkdir(exist_ok=True)
        with home.locked(workspace / "lock", "the build") as lock:
            stamp = _read(workspace / "stamp.json")
            if force or stamp.get("packages") != wanted:
                stamp = _build(
                    root, workspace, environment, wanted, {} if force else stamp, extra if force else [], lock
                )
    return _merged(stamp["variables"], root, environment)


def _read(stamp: Path) -> dict[str, Any]:
    try:
        content = json.loads(stamp.read_text())
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _packages(root: Path, environment: Environment) -> list[Path]:
    standins = [root / "tools" / "standins" / "tf2_msgs"] if environment.ros.prefix is None else []
    return sorted(p.parent for p in root.glob("seed_*/package.xml")) + standins


def _digests(root: Path, environment: Environment) -> dict[str, str]:
    return {package.name: _digest(package) for package in _packages(root, environment)}


def _digest(package: Path) -> str:
    contents = [f for pattern in BUILD_FILES for f in sorted(package.glob(pattern)) if f.is_file()]
    listed = [f for pattern in LINKED_FOLDERS for f in _files_below(package, pattern)]
    parts = [part for f in contents for part in (f.name.encode(), f.read_bytes())]
    return home.digest([*parts, *(str(f.relative_to(package)).encode() for f in listed)])


def _files_below(package: Path, pattern: str) -> list[Path]:
    matches = sorted(package.glob(pattern))
    return [f for match in matches for f in ([match] if match.is_file() else sorted(match.rglob("*"))) if f.is_file()]


def _build(
    root: Path,
    workspace: Path,
    environment: Environment,
    wanted: dict[str, str],
    old: dict[str, Any],
    extra: list[str],
    lock: int,
) -> dict[str, Any]:
    built = old.get("packages", {})
    changed = [name for name, value in wanted.items() if built.get(name) != value]
    link = workspace / "src"
    link.unlink(missing_ok=True)
    link.symlink_to(root, target_is_directory=True)
    paths = [str(link / package.relative_to(root)) for package in _packages(root, environment)]
    command = [
        str(environment.python),
        "-m",
        "colcon",
        "--log-base",
        str(workspace / "log"),
        "build",
        "--symlink-install",
    ]
    command += ["--build-base", str(workspace / "build"), "--install-base", str(workspace / "install")]
    command += ["--base-paths", *paths, "--packages-select", *changed]
    command += [
        "--event-handlers",
        "console_direct+",
        "console_cohesion-",
        "--metas",
        str(link / "colcon.meta"),
    ]
    command += [
        "--cmake-args",
        f"-DPython3_EXECUTABLE={environment.python}",
        "-DBUILD_TESTING=OFF",
        "-Wno-dev",
        *extra,
    ]
    (workspace / "stamp.json").unlink(missing_ok=True)
    what = f"building {len(changed)} packages with colcon"
    run_logged(command, what, workspace / "build.log", _build_variables(environment), _shorten, [lock])
    stamp = {"packages": wanted, "variables": _captured(workspace, environment), "checkout": str(root)}
    temporary = workspace / "stamp.json.new"
    temporary.write_text(json.dumps(stamp, indent=1))
    temporary.replace(workspace / "stamp.json")
    name_leftovers(workspace.parent, environment.path, root)
    return stamp


def _shorten(line: str) -> str:
    return line.strip() if line.startswith(("Starting >>>", "Finished <<<", "Failed", "[")) else ""


def _build_variables(environment: Environment) -> dict[str, str]:
    """What colcon starts from: the ROS 2 below us and nothing else of ours."""
    return _sourced([], environment)


def _captured(workspace: Path, environment: Environment) -> dict[str, str]:
    """What sourcing the workspace sets, kept so that later starts need no shell."""
    variables = _sourced([workspace / "install" / "local_setup.bash"], environment)
    kept = (
        *LISTS,
        "ROS_DISTRO",
        "ROS_VERSION",
        "ROS_PYTHON_VERSION",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
        "VIRTUAL_ENV",
    )
    ours = (environment.path, workspace, *variables["AMENT_PREFIX_PATH"].split(":"))
    found = {name: variables[name] for name in kept if variables.get(name)}
    return {name: _below(value, ours) if name in LISTS else value for name, value in found.items()}


def _below(entries: str, folders: Iterable[Path | str | None]) -> str:
    """The entries of a search path that lie in one of the folders: not those the caller happened to have."""
    prefixes = [str(folder) for folder in folders if folder]
    return ":".join(e for e in entries.split(":") if any(e == p or e.startswith(p + "/") for p in prefixes))


def _sourced(scripts: list[Path], environment: Environment) -> dict[str, str]:
    """The variables of a bash that sources the ROS 2 and then the scripts."""
    ros = environment.ros
    start = {
        k: v for k, v in os.environ.items() if k not in LISTS and k not in ("SEED_ROOT", "ROS_DISTRO", "PYTHONHOME")
    }
    path = [p for p in os.environ.get("PATH", os.defpath).split(":") if not foreign(p)]
    start["PATH"] = ":".join([str(environment.path / "bin"), *path])
    start["VIRTUAL_ENV"] = str(environment.path)
    if ros.prefix is None:
        start |= _wheels_variables(environment.path)
    elif ros.underlays:
        start |= {name: os.environ[name] for name in LISTS if name in os.environ and name != "PATH"}
    elif ros.prefix is not None:
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
    result = dict(os.environ)
    wheels = environment.ros.prefix is None
    for name, value in variables.items():
        if name not in LISTS:
            result[name] = value
            continue
        ours = value.split(":")
        theirs = [p for p in result.get(name, "").split(":") if p and p not in ours and not (wheels and foreign(p))]
        result[name] = ":".join(ours + theirs)
    if wheels:
        result["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"
    for name, value in DEFAULTS.items():
        result.setdefault(name, value)
    if not {"ROS_HOME", "ROS_LOG_DIR"} & result.keys() and not home.can_make("~/.ros"):
        result["ROS_LOG_DIR"] = str(environment.path.parent / "log")  # nodes do not start without a place for logs
    result.pop("PYTHONHOME", None)
    # A start from within finds the same ROS 2 and pins again.
    result["SEED_PINS"] = environment.pins
    result["SEED_ROS"] = "wheels" if wheels else str(environment.ros.prefix)
    result["SEED_UNDERLAYS"] = ":".join(environment.ros.underlays)
    result["SEED_ROOT"] = str(root)
    return result
