# SPDX-License-Identifier: Apache-2.0
"""Stick and slip of the membrane: Coulomb's law at the patch, and the sheet that lets go from the edge inwards."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.hand import Hand
from seed_core.spatial import inverse_pose, make_pose, pose_from_rpy
from seed_sim.tactile import TactileParameters, TactileRenderer
from seed_sim.tactile.friction import Friction
from seed_sim.tactile.sheet import follow_shares
from seed_sim.tactile.trajectory import TrajectorySection
from seed_testing.validation.slip import Pull, moments, random_pull

DT = 0.002  # [s]


def pulled(friction, speed, duration):
    """Every step of a tool that is pulled along x at a speed [m/s]."""
    return [friction.step(make_pose(p=(speed * i * DT, 0.0, 0.0)), i * DT) for i in range(1, int(duration / DT) + 1)]


def test_the_membrane_follows_the_tool_up_to_its_hold():
    held = pulled(Friction(0.008, 0.7, 0.01), 0.05, 0.15)
    assert not any(h.sliding for h in held)
    assert_allclose(held[-1].X_slid, np.eye(4), atol=1e-12)
    assert held[-1].load == pytest.approx(0.0075 / 0.008)


def test_a_sliding_membrane_springs_back_and_stays():
    held = pulled(Friction(0.008, 0.7, 0.01), 0.05, 0.4)
    first = next(i for i, h in enumerate(held) if h.sliding)
    assert (first + 1) * DT * 0.05 == pytest.approx(0.008, abs=2 * DT * 0.05)
    stuck = make_pose(p=(0.05 * len(held) * DT, 0.0, 0.0)) @ inverse_pose(held[-1].X_slid)
    assert stuck[0, 3] == pytest.approx(0.7 * 0.008, abs=1e-5)
    assert all(h.sliding and h.load == 1.0 for h in held[first:])


def test_a_tool_that_stops_sliding_sticks_again():
    friction = Friction(0.008, 0.7, 0.01)
    slid = pulled(friction, 0.05, 0.4)[-1].X_slid
    back = friction.step(make_pose(p=(0.018, 0.0, 0.0)), 0.41)
    assert not back.sliding
    assert_allclose(back.X_slid, slid, atol=1e-9)


def test_a_twist_about_the_cameras_axis_breaks_loose_but_a_deeper_imprint_does_not():
    friction = Friction(0.008, 0.7, 0.01)
    assert friction.displacement(make_pose(p=(0.0, 0.02, 0.0))) == 0.0
    assert friction.displacement(pose_from_rpy((0.0, 0.5, 0.0), np.zeros(3))) > 0.008


def disc(radius, rim, side=121):
    y, x = np.mgrid[:side, :side] - side // 2
    r = np.hypot(x, y)
    return r <= radius, r < rim, r


def test_a_sheet_that_slides_is_poissons_solution_for_a_disc():
    """-laplace(u) = 1 on r < a, u(R) = 0: u = (a^2 - r^2) / 4 + a^2 / 2 ln(R / a) inside, a^2 / 2 ln(R / r) outside."""
    a, R = 16.0, 50.0
    patch, inside, r = disc(a, R)
    u = follow_shares(patch, inside, (0.0, 1.0))[1]
    within, beyond = (a * a - r * r) / 4.0 + a * a / 2.0 * math.log(R / a), a * a / 2.0 * np.log(R / np.fmax(r, 1.0))
    exact = np.where(r < a, within, beyond)
    assert np.abs(u - exact / exact.max())[r < 0.9 * R].max() < 0.02


def test_more_load_lets_go_of_more_of_the_patch():
    patch, inside, _ = disc(16.0, 50.0)
    loads = (0.0, 0.5, 0.8, 1.0)
    sticks = [float((u[patch] > 0.999).mean()) for u in follow_shares(patch, inside, loads)]
    assert sticks[0] == 1.0
    assert all(a > b for a, b in pairwise(sticks))
    assert sticks[-1] < 0.02


def test_dots_of_a_loaded_patch_trail_at_its_edge_and_follow_in_its_middle():
    p = TactileParameters(noise=0.0, pattern=0.0, dropouts=0.0, hold=0.009)
    membrane = TactileRenderer(p, Hand(), 3).membranes["left"]
    X = make_pose(p=(0.006, 0.0, 0.0))
    share = membrane.sheet.share(0.0), membrane.sheet.share(0.8)
    assert share[1].max() == pytest.approx(1.0, abs=1e-3)
    assert float((share[0] - share[1]).max()) > 0.03
    stuck, loose = (membrane.press(X, X, load).material[0] for load in (0.0, 0.8))
    assert float((loose - stuck).max()) > 0.03 * 0.006  # material from further along x is seen: it has moved less


def test_pulls_slip_once_their_grip_gives_way():
    kinds = {tuple(np.nonzero(random_pull(np.random.default_rng(i)).speed)[0]) for i in range(30)}
    assert kinds == {(1,), (3,), (5,)}
    pull = Pull(1.0, np.array((0, 0, 0, 0.05, 0, 0)), hold=0.008, kinetic=0.7)
    assert_allclose(pull.pulled(0.9), np.eye(4))
    assert_allclose(pull.pulled(1.1)[:3, 3], (0.005, 0, 0))
    p = replace(TactileParameters(), hold=pull.hold, kinetic=pull.kinetic)
    still = TrajectorySection(duration=1.5, translation_mm=(0, 0, 0), rotation_deg=(0, 0, 0))
    seen = list(moments(p, 0.01, still, pull, 1))
    assert seen[-1].onset == pytest.approx(1.0 + 0.008 / 0.05, abs=0.003)
    assert not any(m.held.sliding for m in seen if m.stamp < seen[-1].onset)
