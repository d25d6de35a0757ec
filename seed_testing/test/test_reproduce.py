# SPDX-License-Identifier: Apache-2.0
"""The reproduced figures: the pen's model follows Hertz, strokes are cut out of a run, wrong arguments are named."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_control.tasks import load_task
from seed_core.program.files import shared_path
from seed_sim.closed_loop.recording import Recording
from seed_sim.scenario import load_scenario
from seed_testing.reproduce.command import main
from seed_testing.reproduce.fig7 import ACROSS_SCENARIO, ACROSS_TASK, CASES, _draw
from seed_testing.reproduce.pen import TIP_MODULUS, TIP_RADIUS, darkness, stroke_width, strokes_of
from seed_testing.reproduce.report import table, write


def recorded(forces: tuple[float, ...] = (1.0, 3.0)) -> Recording:
    """Strokes of 40 mm in x, each with a steady force, with the tip 0.2 mm off in y."""
    recording = Recording(["approach", *(f"stroke {i + 1}/{len(forces)} draw" for i in range(len(forces)))])
    t = 0.0
    for i, force in enumerate((0.0, *forces)):
        for x in np.linspace(0.0, 0.04, 501):
            t += 0.004
            reference = np.array((x, 0.02 * i, 0.0))
            recording.add(
                t=t,
                phase=i,
                force=np.array((0.0, 0.0, -force)),
                wanted_force=np.array((0.0, 0.0, -force)),
                tip=reference + np.array((0.0, 2e-4, 0.0)),
                reference=reference,
            )
    return recording


def test_line_is_as_wide_as_hertz_contact():
    F = 2.0
    a = 0.5 * stroke_width(F)
    # a ball of radius R pressed onto a plane: F = 4/3 E a^3 / R
    assert_allclose(4.0 / 3.0 * TIP_MODULUS * a**3 / TIP_RADIUS, F)
    assert stroke_width(0.0) == 0.0
    assert stroke_width(-1.0) == 0.0


def test_pressing_harder_draws_wider_and_darker():
    forces = np.linspace(0.1, 5.0, 30)
    assert (np.diff(stroke_width(forces)) > 0.0).all()
    assert (np.diff(darkness(forces)) > 0.0).all()
    assert 0.0 < darkness(0.1) < darkness(5.0) < 1.0
    assert darkness(0.0) == 0.0


def test_strokes_know_their_force_width_and_path_error():
    strokes = strokes_of(recorded())
    assert [s.name for s in strokes] == ["stroke 1/2 draw", "stroke 2/2 draw"]
    for stroke, force in zip(strokes, (1.0, 3.0), strict=True):
        s = stroke.statistics()
        assert_allclose([s["commanded"], s["force_mean"], s["force_rmse"]], [force, force, 0.0], atol=1e-12)
        assert_allclose(s["path_rmse_mm"], 0.2)
        assert_allclose(s["width_mm_mean"], 1e3 * stroke_width(force))


def test_figure_and_numbers_are_written(tmp_path: Path):
    lines = {label: strokes_of(recorded()) for label, *_ in CASES} | {"writing": strokes_of(recorded((2.0,)))}
    assert _draw(lines, "writing", tmp_path / "fig7.png").stat().st_size > 10_000
    files = write(tmp_path, "numbers", table(["a", "b"], [["x", "1"]]), {"v": np.float64(1.5), "none": float("nan")})
    assert json.loads(files[1].read_text()) == {"v": 1.5, "none": None}
    assert files[0].read_text().splitlines()[2].split() == ["x", "1"]


def test_pen_across_the_hand_presses_along_y_of_the_hand():
    task, scenario = (
        load(str(shared_path("seed_testing", file)))
        for load, file in ((load_task, ACROSS_TASK), (load_scenario, ACROSS_SCENARIO))
    )
    R_tip_W = np.diag([1.0, -1.0, -1.0])  # tip_rpy of 180 0 0 degrees
    R_WT = R_tip_W @ scenario.tool.X_Ttip[:3, :3].T
    assert_allclose(R_WT[:, 1], (0.0, 0.0, -1.0), atol=1e-12)  # y_T, and so y_C, points into the paper
    assert task.tip_rpy == (180.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "figure"),
        (["fig5"], "fig4"),
        (["fig6", "--seed", "x"], "whole number"),
        (["fig6", "--force", "-1"], "-1 must be a number from 0.1 to 200 N"),
    ],
)
def test_wrong_arguments_are_named_in_one_line(arguments, words, capsys):
    with pytest.raises(SystemExit):
        main(arguments)
    told = capsys.readouterr().err
    assert words in told
    assert told.endswith("seed reproduce --help tells more\n")


@pytest.mark.parametrize("force", ["-5", "0", "0.05", "201", "nan"])
def test_impossible_force_is_named(force, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["fig6", "--force", force, "--out", str(tmp_path)])
    assert f"argument --force: {force} must be a number from 0.1 to 200 N;" in capsys.readouterr().err
