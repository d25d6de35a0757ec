# SPDX-License-Identifier: Apache-2.0
"""Scenario files: what is shipped loads, what is wrong is refused with file, line and bound."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import seed_sim
from seed_core.config import ConfigError
from seed_sim.plant.table import draw_surface
from seed_sim.scenario import COLUMNS, SHIPPED, Scenario, load_scenario, scenario_file, shipped_scenarios


@pytest.mark.parametrize("name", shipped_scenarios())
def test_every_shipped_scenario_loads_under_its_own_name(name):
    assert load_scenario(name).name == name


def test_every_column_is_shipped_and_differs_from_nominal():
    assert set(COLUMNS) <= set(shipped_scenarios())
    for name in set(COLUMNS) - {"nominal"}:
        assert load_scenario(name) != load_scenario("nominal")


def test_nominal_is_the_default():
    nominal, default = load_scenario("nominal"), Scenario()
    assert (nominal.grasp, nominal.servo, nominal.table, nominal.measurement) == (
        default.grasp,
        default.servo,
        default.table,
        default.measurement,
    )


def test_folders_are_searched_in_order_and_a_file_needs_none():
    validate, evaluate = ("seed_testing", "config/validate"), SHIPPED
    assert scenario_file("slip20", validate, evaluate) != scenario_file("slip20", evaluate, validate)  # both have one
    assert scenario_file("nominal", validate, evaluate) == scenario_file("nominal", evaluate)
    assert scenario_file("nominal", validate) is None
    assert scenario_file("mine.yaml") == Path("mine.yaml")
    assert load_scenario("nominal", validate, evaluate) == load_scenario("nominal")


def test_the_public_face_waits_with_drake_until_a_plant_is_made():
    words = "import sys, seed_sim; print(callable(seed_sim.evaluate), 'pydrake' in sys.modules, 'rclpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "False", "False"]


def test_the_public_face_imports_each_name_when_it_is_asked_for():
    words = "import sys, seed_sim.scenario; print('seed_control' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]
    assert all(hasattr(seed_sim, name) for name in seed_sim.__all__)
    assert seed_sim.load_scenario is load_scenario
    with pytest.raises(AttributeError, match="'seed_sim' has no attribute 'simulate'"):
        _ = seed_sim.simulate


def test_unknown_name_lists_what_there_is():
    with pytest.raises(ConfigError, match=r"'calm' is unknown; shipped: .*nominal"):
        load_scenario("calm")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tabel: {friction: 0.3}", r"mine\.yaml:1: unknown key 'tabel'"),
        ("name: x\ntable: {friction: -1}", r"mine\.yaml:2: table\.friction = -1 must be within 0 and 2"),
        ("grasp:\n  damping_ratio: .nan", r"mine\.yaml:2: grasp\.damping_ratio = nan must be finite"),
        ("servo: {lag: 15 ms}", r"servo\.lag = '15 ms' must be a number \(s; first-order lag"),
        (
            "grasp: {stiffness: {rotation: [4, 3, 0], translation: [1, 1, 1]}}",
            r"rotation\[2\] = 0 N m/rad must be within",
        ),
        (
            "table:\n  tilt_x: [3.0, -3.0]",
            r"mine\.yaml:2: table\.tilt_x = \[3, -3\] must run from low to high: \[-3, 3\]",
        ),
        ("gel: {gamma: [2.4, 1.8]}", r"gel\.gamma = \[2\.4, 1\.8\] must run from low to high: \[1\.8, 2\.4\]"),
        ("servo: {arm: panda}", r"servo\.arm = 'panda' must be one of: cartesian, ur5e, ur10e"),
    ],
)
def test_wrong_file_is_refused_with_line_and_bound(tmp_path: Path, text, message):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message):
        load_scenario(file)


def test_one_number_is_a_span_without_width(tmp_path: Path):
    file = tmp_path / "tilted.yaml"
    file.write_text("table: {tilt_x: 1.5, tilt_y: -1, height: -2}")
    surface = draw_surface(load_scenario(file).table, np.eye(4), np.random.default_rng(1), 5)
    assert_allclose(surface.X_WS[2, 3], -0.002)
    assert_allclose(np.rad2deg(np.arctan2(surface.X_WS[2, 1], surface.X_WS[2, 2])), 1.5)


def test_tables_are_drawn_within_their_bounds_and_from_the_seed():
    scenario = load_scenario("nominal")
    tables = [draw_surface(scenario.table, np.eye(4), np.random.default_rng([s, 1]), 5).X_WS for s in range(200)]
    heights = np.array([X[2, 3] for X in tables])
    tilts = np.rad2deg(np.arccos([X[2, 2] for X in tables]))
    assert np.abs(heights).max() <= 3e-3
    assert np.ptp(heights) > 5e-3
    assert tilts.max() <= np.hypot(2.0, 2.0) + 1e-3
    assert tilts.max() > 2.0
    again = draw_surface(scenario.table, np.eye(4), np.random.default_rng([7, 1]), 5).X_WS
    assert_allclose(again, tables[7], rtol=0.0)
