# SPDX-License-Identifier: Apache-2.0
"""Installs seed_sysid: what it is stands in setup.cfg; every file below config and launch goes along."""

from pathlib import Path

from setuptools import setup

SHARE = "share/seed_sysid"
folders = {f.parent for top in ("config", "launch") for f in Path(top).rglob("*.*")}
setup(
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/seed_sysid"]),
        (SHARE, ["package.xml"]),
        *((f"{SHARE}/{d}", [str(f) for f in sorted(d.iterdir()) if f.is_file()]) for d in sorted(folders)),
    ]
)
