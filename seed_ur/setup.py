# SPDX-License-Identifier: Apache-2.0
"""Installs seed_ur: what it is stands in setup.cfg."""

from setuptools import setup

INDEX = "share/ament_index/resource_index/packages"
setup(data_files=[(INDEX, ["resource/seed_ur"]), ("share/seed_ur", ["package.xml"])])
