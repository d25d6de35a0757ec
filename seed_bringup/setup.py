# SPDX-License-Identifier: Apache-2.0
"""Installation of seed_bringup; files under config/, launch/ and the like need no line here."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "seed_bringup"
SHARED = ("config", "launch", "rviz", "layouts", "urdf")


def shared_files() -> list[tuple[str, list[str]]]:
    """Every file below the shared folders, installed at the same place under share/."""
    found: dict[str, list[str]] = {}
    for file in (f for folder in SHARED for f in sorted(Path(folder).glob("**/*")) if f.is_file()):
        found.setdefault(f"share/{NAME}/{file.parent}", []).append(str(file))
    return list(found.items())


setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(exclude=["test", "test.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *shared_files(),
    ],
    package_data={NAME: ["py.typed", "data/*", "templates/*"]},
    zip_safe=False,
    maintainer="SEED developers",
    maintainer_email="seed@example.org",
    description="Launch files, configuration, the launcher, bag tools, the demo and its report.",
    license="Apache-2.0",
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": ["link_frames = seed_bringup.links_node:main", "seed = seed_bringup.cli:main"],
    },
)
