# SPDX-License-Identifier: Apache-2.0
"""Rules that hold for the whole repository; they need its checkout."""

import ast
import configparser
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import pytest

from seed_bringup.command_table import offered, usage
from seed_bringup.commands.developer import cores, is_edge

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(not (ROOT / "seed").is_file(), reason="this is an installed copy, not the checkout")

SUITE = {p.parent.name for p in ROOT.glob("seed_*/package.xml")}
# What the cores of a package may import beside the standard library and itself.
NUMERIC = {"numpy", "scipy", "yaml"}
MAY_IMPORT = {
    "seed_core": NUMERIC,
    "seed_ur": NUMERIC | {"seed_core"},
    "seed_control": NUMERIC | {"seed_core", "HersheyFonts"},
    "seed_estimation": NUMERIC | {"seed_core", "cv2", "pyrealsense2"},
    "seed_driver": NUMERIC | {"seed_core", "seed_ur", "rtde_control", "rtde_receive", "rtde_io", "dashboard_client"},
    "seed_sysid": NUMERIC | {"seed_core", "matplotlib"},
    "seed_sim": NUMERIC
    | {"seed_core", "seed_ur", "seed_control", "seed_estimation", "seed_sysid"}
    | {"cv2", "pydrake", "tqdm", "joblib", "matplotlib", "viser", "gymnasium"},
    "seed_bringup": None,  # puts everything together
}


def imported(file: Path) -> Iterator[str]:
    """Top-level names of every import in a file, those inside functions too."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module.split(".")[0]


def of_ros(name: str) -> bool:
    return name in ("rclpy", "seed_ros", "tf2_ros", "cv_bridge") or name.endswith(("_msgs", "_srvs", "_interfaces"))


def test_where_a_checkout_lies_makes_no_module_an_edge() -> None:
    assert not is_edge(Path("/home/me/ros/seed_core/seed_core/errors.py"))
    assert is_edge(Path("seed_sim/seed_sim/ros/node.py"))
    assert is_edge(Path("seed_ros/seed_ros/images/arrays.py"))


@pytest.mark.parametrize("package", sorted(SUITE - {"seed_msgs", "seed_ros", "seed_testing"}))
def test_cores_import_neither_ros_nor_what_lies_above_them(package: str) -> None:
    files = [ROOT / f for f in cores(ROOT) if f.parts[0] == package]
    assert files, f"{package} has no core"
    allowed = MAY_IMPORT[package]
    for file in files:
        names = set(imported(file)) - set(sys.stdlib_module_names) - {package}
        assert not {n for n in names if of_ros(n)}, f"{file.relative_to(ROOT)} is core and imports ROS"
        if allowed is not None:
            assert names <= allowed, f"{file.relative_to(ROOT)} imports {sorted(names - allowed)}"


@pytest.mark.parametrize("package", sorted(SUITE - {"seed_msgs"}))
def test_packages_declare_what_they_import(package: str) -> None:
    manifest = ET.parse(ROOT / package / "package.xml").getroot()
    declared = {e.text for e in manifest if e.tag.endswith("depend")}
    files = sorted((ROOT / package / package).glob("**/*.py"))
    assert files, f"{package} has no source"
    for file in files:
        used = {n for n in imported(file) if n in SUITE or (of_ros(n) and is_edge(file))} - {package}
        assert used <= declared, f"{file.relative_to(ROOT)}: package.xml lacks {sorted(used - declared)}"


@pytest.mark.parametrize("package", sorted(SUITE - {"seed_msgs", "seed_sim", "seed_bringup", "seed_testing"}))
def test_products_import_neither_the_simulator_nor_the_instruments(package: str) -> None:
    for file in sorted((ROOT / package / package).glob("**/*.py")):
        assert not {"seed_sim", "seed_bringup", "seed_testing"} & set(imported(file)), file.relative_to(ROOT)
    assert "seed_testing" not in {n for f in (ROOT / "seed_bringup").glob("seed_bringup/**/*.py") for n in imported(f)}


def test_packages_import_only_those_above_them_in_the_table_of_the_architecture() -> None:
    order = re.findall(r"^\| `(seed_\w+)` \|", (ROOT / "docs/architecture.md").read_text(), re.MULTILINE)
    assert set(order) == SUITE
    for file in sorted(ROOT.glob("seed_*/seed_*/**/*.py")):
        package = file.relative_to(ROOT).parts[0]
        higher = set(order[order.index(package) + 1 :]) & set(imported(file))
        assert not higher, f"{file.relative_to(ROOT)} imports {sorted(higher)}"


def imported_modules(file: Path, known: dict[str, Path]) -> Iterator[str]:
    """Modules of the suite that a file imports anywhere, but for what only a type checker reads."""
    tree = ast.parse(file.read_text())
    for block in (n for n in ast.walk(tree) if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"):
        block.body = [ast.Pass()]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                yield name if name in known else node.module


def test_no_module_imports_itself_in_a_circle() -> None:
    files = [f for f in sorted(ROOT.glob("seed_*/seed_*/**/*.py")) if f.name != "__init__.py"]
    known = {".".join(f.relative_to(ROOT).with_suffix("").parts[1:]): f for f in files}
    ways = {name: set(imported_modules(f, known)) & set(known) - {name} for name, f in known.items()}
    while ends := {name for name, uses in ways.items() if not uses & set(ways)}:
        ways = {name: uses for name, uses in ways.items() if name not in ends}
    assert not ways, f"in circles, or above one: {sorted(ways)}"


def test_folders_stay_small() -> None:
    folders = {f.parent for f in ROOT.glob("seed_*/seed_*/**/*.py")}
    assert len(folders) > 50
    for folder in folders:
        assert len(list(folder.glob("*.py"))) <= 12, f"{folder.relative_to(ROOT)} has more than 12 modules"


def tracked(*patterns: str) -> list[Path]:
    command = ["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard", *patterns]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        return [f for pattern in patterns for f in ROOT.rglob(pattern)]
    return [ROOT / line for line in done.stdout.splitlines() if (ROOT / line).is_file()]


def test_every_source_file_states_its_licence_first() -> None:
    patterns = ["*.py", "*.xml", "*.yaml", "*.txt", "*.toml", "*.msg", "*.srv", "*.action", "seed", ".ci/run"]
    files, manifests = tracked(*patterns), sorted(ROOT.glob("seed_*/package.xml"))
    assert {f.suffix for f in files} >= {".py", ".xml", ".yaml", ".txt", ".toml", ".msg", ".srv", ".action"}
    assert {m.parent.name for m in manifests} == SUITE
    for file in files:
        lines = file.read_text().splitlines()[:3]
        assert any("SPDX-License-Identifier: Apache-2.0" in line for line in lines), file.relative_to(ROOT)
    assert "Apache License" in (ROOT / "LICENSE").read_text()
    for manifest in manifests:
        assert ET.parse(manifest).findtext("license") == "Apache-2.0"


def test_the_readme_installs_what_apt_lacks_where_pip_may_and_with_the_pins() -> None:
    """Ubuntu 24.04 refuses a plain `pip install`."""
    section = (ROOT / "README.md").read_text().split("## Packages")[1].split("\n## ")[0]
    installed = re.findall(r"pip install (.*?)(?:  |$|`)", section, re.MULTILINE)
    assert installed == ["-r src/<this repository>/requirements/apt.txt"]
    assert section.index("-m venv --system-site-packages") < section.index("pip install")
    assert (ROOT / "requirements/apt.txt").is_file()


def test_every_dependency_is_pinned_exactly() -> None:
    files = sorted((ROOT / "requirements").glob("*.txt"))
    lines = [(file.name, line) for file in files for line in file.read_text().splitlines()]
    libraries = [(name, line) for name, line in lines if line and not line.startswith(("#", "-r "))]
    assert {name for name, _ in libraries} == {file.name for file in files}
    assert len(libraries) > 20
    for name, line in libraries:
        assert re.match(r"[\w.-]+==[\w.]+(;.*|  #.*)?$", line), f"{name}: {line}"


PROVIDES = {
    "foxglove": "foxglove-sdk",
    "pydrake": "drake",
    "cv2": "opencv-contrib-python-headless",
    "yaml": "PyYAML",
    "HersheyFonts": "Hershey-Fonts",
}
PROVIDES |= dict.fromkeys(("rtde_control", "rtde_receive", "rtde_io", "dashboard_client"), "ur-rtde")


def test_every_imported_library_is_pinned() -> None:
    pinned = {
        re.split("==", line)[0].lower()
        for file in (ROOT / "requirements").glob("*.txt")
        for line in file.read_text().splitlines()
    }
    used: set[str] = set()
    for file in sorted(ROOT.glob("seed_*/seed_*/**/*.py")):
        names = set(imported(file)) - set(sys.stdlib_module_names) - SUITE - {"ament_index_python"}
        libraries = {PROVIDES.get(n, n).lower() for n in names if not of_ros(n)}
        used |= libraries
        assert libraries <= pinned, f"{file.relative_to(ROOT)}: requirements/ lacks {sorted(libraries - pinned)}"
    assert used >= {"numpy", "scipy", "drake", "ur-rtde", "rosbags", "matplotlib"}


@pytest.mark.parametrize("package", sorted(SUITE - {"seed_msgs"}))
def test_what_a_core_imports_is_installed_with_it(package: str) -> None:
    """`pip install ./seed_core` must suffice. What a function imports when it is called is for those who call it."""
    settings = configparser.ConfigParser()
    settings.read(ROOT / package / "setup.cfg")
    declared = {re.split("[=<>;]", x)[0].strip() for x in settings["options"]["install_requires"].split("\n") if x}
    used = {n for f in cores(ROOT) if f.parts[0] == package for n in imported_at_once(ROOT / f)}
    needed = {PROVIDES.get(n, n) for n in used - set(sys.stdlib_module_names) - {package, "ament_index_python"}}
    lacking = {n.lower() for n in needed if not of_ros(n)} - {d.lower() for d in declared}
    known = set().union(*(_brought_by(d) for d in declared & SUITE))
    assert not lacking - known, f"{package}/setup.cfg: install_requires lacks {sorted(lacking - known)}"


def imported_at_once(file: Path) -> Iterator[str]:
    """Top-level names of what a file imports when it is imported itself."""
    for node in ast.parse(file.read_text()).body:
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.split(".")[0]


def _brought_by(package: str) -> set[str]:
    """What pip installs with a package of the suite, in small letters."""
    settings = configparser.ConfigParser()
    settings.read(ROOT / package / "setup.cfg")
    own = {re.split("[=<>;]", x)[0].strip() for x in settings["options"]["install_requires"].split("\n") if x}
    return {d.lower() for d in own}.union(*(_brought_by(d) for d in own & SUITE))


@pytest.mark.skipif(os.environ.get("SEED_ROS") != "wheels", reason="looks at the environment that ./seed makes")
def test_pins_are_complete() -> None:
    """They are installed without looking for dependencies, so none may be missing."""
    done = subprocess.run([sys.executable, "-m", "pip", "check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_metas_name_the_python_packages_that_exist() -> None:
    names = json.loads((ROOT / "colcon.meta").read_text())["names"]
    assert set(names) == {p.parent.name for p in ROOT.glob("seed_*/setup.py")}


def test_stand_ins_are_hidden_from_ordinary_workspaces() -> None:
    assert (ROOT / "tools/standins/COLCON_IGNORE").exists()


def test_every_offered_command_has_its_function() -> None:
    for command in offered(checkout=True).values():
        file = ROOT / command.module.split(".")[0] / (command.module.replace(".", "/") + ".py")
        functions = {n.name for n in ast.parse(file.read_text()).body if isinstance(n, ast.FunctionDef)}
        assert command.function in functions, f"{command.name}: {file} has no {command.function}"
    assert offered(checkout=True).keys() >= {"demo", "test", "launch", "evaluate", "bench", "bag", "shell", "lint"}


@pytest.mark.parametrize("checkout", [True, False])
def test_the_help_names_every_command_once_below_a_heading(checkout: bool) -> None:
    commands = offered(checkout=checkout)
    blocks = [block.splitlines() for block in usage(commands).split("\n\n") if block.splitlines()[0].endswith(":")]
    assert len(blocks) == (5 if checkout else 4)
    assert sorted(line.split()[0] for _, *lines in blocks for line in lines) == sorted(commands)
    assert all(lines for _, *lines in blocks)


def test_help_and_mistakes_need_no_set_up(tmp_path: Path) -> None:
    environment = {"PATH": "/usr/bin:/bin", "SEED_PYTHON": sys.executable, "SEED_HOME": str(tmp_path / "none")}
    shown = subprocess.run([ROOT / "seed", "--help"], env=environment, capture_output=True, text=True, cwd=tmp_path)
    assert shown.returncode == 0
    assert "./seed COMMAND" in shown.stdout
    wrong = subprocess.run([ROOT / "seed", "dmeo"], env=environment, capture_output=True, text=True, cwd=tmp_path)
    assert wrong.returncode == 2
    assert "no command 'dmeo'" in wrong.stderr
    command = [ROOT / "seed", "build", "--nonsense"]
    wrong = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=tmp_path)
    assert (wrong.returncode, wrong.stderr) == (
        2,
        "seed: build takes settings of CMake, -DNAME=VALUE, not --nonsense\n",
    )
    assert not (tmp_path / "none").exists()


def test_documents_link_to_what_is_there_and_name_commands_that_exist() -> None:
    pages = [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md"))]
    anchors = {page: {_anchor(h) for h in re.findall(r"^#+ (.*)$", page.read_text(), re.M)} for page in pages}
    links, commands = 0, set()
    for page, text in ((page, page.read_text()) for page in pages):
        for target, anchor in re.findall(r"\]\(([^)#:]*)(?:#([^)]*))?\)", text):
            links += 1
            there = (page.parent / target).resolve() if target else page
            assert there.exists(), f"{page.name} links to {target}"
            assert not anchor or anchor in anchors[there], f"{page.name} links to {target}#{anchor}"
        for name in re.findall(r"\./seed ([a-z][a-z-]*)", text):
            commands.add(name)
            assert name in offered(checkout=True), f"{page.name} speaks of ./seed {name}"
    assert links > 20
    assert commands >= {"demo", "test", "launch", "call", "play"}


def test_every_page_is_in_the_menu_of_the_site() -> None:
    menu = set(re.findall(r"[\w/]+\.md", (ROOT / "mkdocs.yml").read_text()))
    made = {"commands.md", "contributing.md", "changelog.md"}
    assert {str(f.relative_to(ROOT / "docs")) for f in ROOT.glob("docs/**/*.md")} == menu - made, "mkdocs.yml: nav"


def test_architecture_names_the_file_that_has_each_part_of_the_paper() -> None:
    """A file says in its own words what the table says of it."""
    page = (ROOT / "docs/architecture.md").read_text()
    rows = re.findall(r"^\| ([A-Z][^|]*) \| \[[^]]*\]\(\.\./([^)]*)\) \|$", page, re.MULTILINE)
    assert len(rows) == 11
    for name, file in rows:
        text = " ".join((ROOT / file).read_text().lower().split())
        for words in re.split(", | and ", name.lower()):
            assert words in text, f"{file} does not speak of {words}"


def _anchor(heading: str) -> str:
    """As GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
