# SPDX-License-Identifier: Apache-2.0
"""Installs seed_ros: what it is stands in setup.cfg."""

from setuptools import setup

INDEX = "share/ament_index/resource_index/packages"
setup(data_files=[(INDEX, ["resource/seed_ros"]), ("share/seed_ros", ["package.xml"])])
