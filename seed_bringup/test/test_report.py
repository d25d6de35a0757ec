# SPDX-License-Identifier: Apache-2.0
"""The report of a run opens without a network and says what the numbers say."""

import multiprocessing
import re
import shlex
import shutil
import signal
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from seed_bringup.commands.demo import _parser
from seed_bringup.demo.baselines import finished, running_baselines
from seed_bringup.demo.conclusion import _Conclusion
from seed_bringup.demo.figures import force_and_torque, path_on_table, relative_pose, true_and_believed
from seed_bringup.demo.hidden import HIDDEN, at_camera_rate
from seed_bringup.demo.live import LiveRun, patience_with
from seed_bringup.demo.plan import plan
from seed_bringup.demo.report import Picture, Report, text_table
from seed_bringup.demo.score import BeliefCurves, Curve, Phase, deviations, score_of_belief, scored_stretches
from seed_bringup.demo.series import Series
from seed_bringup.pictures.scene import Scene, bodies, setup_picture
from seed_control.tasks import load_task
from seed_core.errors import SeedError
from seed_core.hand import Hand, Tool
from seed_core.spatial import make_pose, pose_from_rpy
from seed_sim.closed_loop.recording import Recording
from seed_sim.scenario import load_scenario

PNG = b"\x89PNG\r\n\x1a\n" + bytes(20)


def a_score(rmse: float) -> dict[str, object]:
    return {
        "force_z": {"rmse": rmse, "mean": -10.0, "max_abs_error": 2 * rmse},
        "torque_x": {"rmse": 0.02, "mean": 0.0, "max_abs_error": 0.05},
        "lean_deg": {"rms": 1.5, "max": 3.0},
        "path_rmse_mm": float("nan"),
    }


@pytest.fixture(scope="module")
def report() -> Report:
    t = np.linspace(0.0, 6.0, 200)
    phases = [Phase("approach", 0.0, 1.0), Phase("press", 1.0, 2.0), Phase("wipe", 2.0, 6.0)]
    poses = Series(t, np.stack([pose_from_rpy([0.0, 0.1 * np.sin(s), 0.0], [0.0, 0.0, -0.01]) for s in t]))
    run = Curve(t, np.minimum(10.0, 5.0 * t), np.zeros_like(t))
    return Report(
        title="Squeegee <b>",
        subtitle="a & b",
        held=True,
        scores={"seed": a_score(0.12), "open_loop": a_score(9.0)},
        force_figure=force_and_torque({"SEED": run, "open loop": run}, 10.0, [(3.0, 6.0)], phases),
        pose_figure=relative_pose(poses, poses, phases),
        pictures=[Picture(PNG, "press")],
        details={"command": "./seed demo"},
        replay="replay.html",
        asked="press <here>",
        happened="It pressed.",
        setup=PNG,
    )


class Links(HTMLParser):
    """Every address that a browser would load, and the identifiers in the page."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.ids: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if tag in ("img", "script", "link", "iframe", "use", "image") and name in ("src", "href", "xlink:href"):
                self.loads.append(value or "")
            if name == "id":
                self.ids.append(value or "")


def test_nothing_is_loaded_from_elsewhere(report: Report) -> None:
    page = Links()
    html = report.html()
    page.feed(html)
    assert any(link.startswith("data:image/png") for link in page.loads)
    assert all(link.startswith(("data:", "#")) for link in page.loads), page.loads
    assert not re.search(r"url\(\s*['\"]?https?:|@import|<script", html)


def test_the_story_comes_first_with_a_picture_and_the_way_to_the_replay(report: Report) -> None:
    html = replace(report, scores={"seed": a_score(0.1), "welded": a_score(0.2)}).html()
    order = ["press &lt;here&gt;", "It pressed.", 'href="replay.html"', 'class="setup"', "force error rms", "<table>"]
    places = [html.index(words) for words in order]
    assert places == sorted(places)
    assert html.index("bolted to the gripper") < html.index("<svg"), "welded is explained before it is drawn"
    assert "blade" not in html


def test_a_triangle_is_drawn_as_a_triangle() -> None:
    corners = np.array([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.05, 0.08, 0.0), (0.0, 0.0, 0.0)])
    s = np.linspace(0.0, 3.0, 301)
    line = np.column_stack([np.interp(s, range(4), corners[:, i]) for i in range(3)])
    n = len(s)
    rows = {
        "t": list(s + 5.0),
        "phase": [0] * n,
        "tip": list(line + 0.001),
        "reference": list(line),
        "force": list(np.tile((0.0, 0.0, -2.0), (n, 1))),
    }
    figure = path_on_table(Recording(["draw"], rows=rows), "draw")
    dashed = re.findall(r'<path d="(M [^"]*)"[^>]*stroke-dasharray: 4', figure)
    assert dashed, "the wanted path"
    drawn = np.array([[float(v) for v in point.split()] for point in re.findall(r"[ML] ([-\d. ]+)", dashed[0])])
    width, height = np.ptp(drawn, axis=0)
    assert height / width == pytest.approx(0.8, abs=0.02)
    top = drawn[drawn[:, 1].argmin()]  # in a picture y points down
    assert top[0] == pytest.approx(0.5 * (drawn[:, 0].min() + drawn[:, 0].max()), abs=0.05 * width)


def test_the_set_up_is_drawn_with_arm_hand_and_force() -> None:
    hand, tool = Hand(), Tool()
    X_WC = make_pose(np.diag((1.0, -1.0, -1.0)), (0.45, 0.0, 0.12))
    path = np.array([(0.45 + 0.01 * i, 0.0, 0.0) for i in range(9)])
    args = (hand, tool, "squeegee", X_WC, np.eye(4), make_pose(None, (0.45, 0.0, 0.0)))
    scene = Scene(*args, path, np.arange(9) > 3, np.array((0.0, 0.0, 10.0)))
    assert len(bodies(scene)) == len(bodies(Scene(*args))) + 3  # two stretches of the path, and an arrow
    assert len(bodies(scene, arm=False)) < len(bodies(scene))
    data = setup_picture(scene, (240, 128))
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert pixels.shape == (128, 240, 3)
    assert (pixels < 200).any(axis=2).mean() > 0.3, "the cell fills the picture"


def test_the_figures_do_not_share_identifiers(report: Report) -> None:
    page = Links()
    page.feed(report.html())
    assert len(page.ids) > 10
    assert len(page.ids) == len(set(page.ids))


def test_numbers_stand_where_they_belong_and_missing_ones_are_dashes(report: Report) -> None:
    html = report.html()
    assert "<b>0.12 N</b><span>force error rms</span>" in html
    assert "<td>9.00</td>" in html
    assert "<td>-</td>" in html  # the path error is not a number
    assert "Squeegee &lt;b&gt;" in html
    assert "force held" in html
    lines = text_table(report.scores).splitlines()
    assert [line.split()[0] for line in lines[1:]] == ["SEED", "open"]
    assert lines[1].split()[1:] == ["0.12", "0.020", "1.5"]


def test_the_figure_of_belief_stands_in_the_report_with_what_was_hidden(report: Report) -> None:
    t = np.linspace(0.0, 6.0, 200)
    run = BeliefCurves(t, np.full(200, 9.8), np.full(200, 10.1), np.full(200, 0.2), np.full(200, 10.0))
    figure = true_and_believed(run, [(3.0, 6.0)], [Phase("wipe", 2.0, 6.0)])
    assert "<!-- believed, with 2 stated deviations -->" in figure
    told = {"believed_z": {"rmse": 0.11, "error": 0.31, "bias": 0.3, "stated": 0.2, "in_band": 0.954}}
    html = replace(report, belief_figure=figure, hidden="<a>", scores={"seed": a_score(0.2) | told}).html()
    assert "&lt;a&gt;" in html
    assert "<b>95 %</b><span>truth in band</span>" in html
    assert "<b>0.11 N</b><span>believed error rms</span>" in html
    assert "truth in band" not in report.html()  # nothing is known of it there
    page = Links()
    page.feed(html)
    assert len(page.ids) == len(set(page.ids))


def test_phases_are_named_where_there_is_room_for_their_names() -> None:
    t = np.linspace(0.0, 6.0, 200)
    run = {"SEED": Curve(t, np.full(200, 2.0), np.zeros(200))}
    strokes = [Phase(f"stroke {i + 1}/12 draw", 0.5 * i, 0.5 * i + 0.5) for i in range(12)]
    assert "1/12 draw" in force_and_torque(run, 2.0, [(3.0, 6.0)], strokes[:4])
    assert "/12 draw" not in force_and_torque(run, 2.0, [(3.0, 6.0)], strokes)  # they would cover each other


def test_the_curves_of_a_task_that_ended_before_it_was_scored_are_drawn() -> None:
    phases = [Phase("approach", 0.0, 1.0), Phase("press", 1.0, 2.0), Phase("wipe", 2.0, 2.995)]
    t = np.arange(0.0, 2.995, 0.01)
    run = Curve(t, np.full_like(t, 2.0), np.zeros_like(t))
    assert "press" in force_and_torque({"SEED": run}, 2.0, [], phases)


def test_what_is_scored_is_each_stroke_from_two_seconds_after_contact_and_not_the_way_between() -> None:
    names = ("1/3 touch", "1/3 draw", "2/3 over", "2/3 draw", "3/3 over", "3/3 draw", "lift")
    phases = [Phase(f"stroke {n}" if "/" in n else n, float(i), i + 1.0) for i, n in enumerate(names)]
    assert scored_stretches(phases, "draw", contact=1.5) == [(3.5, 4.0), (5.0, 6.0)]
    rows = {"t": [0.05 * i for i in range(140)], "phase": [i // 20 for i in range(140)]}
    rows["force"] = [(0.0, 0.0, -2.0 * (t >= 1.5)) for t in rows["t"]]
    recording = Recording([p.name for p in phases], rows=rows)
    counted = recording["t"][recording.scored("draw")]
    shaded = [any(a <= t < b for a, b in scored_stretches(phases, "draw", 1.5)) for t in recording["t"]]
    np.testing.assert_array_equal(counted, recording["t"][shaded])  # what the score counts


def test_nothing_is_shaded_of_a_task_that_ended_before_it_was_scored() -> None:
    phases = [Phase("approach", 0.0, 1.0), Phase("press", 1.0, 2.0), Phase("wipe", 2.0, 3.0)]
    assert scored_stretches(phases, "wipe", contact=1.5) == []


def test_the_curves_of_the_pose_claim_no_images(report: Report) -> None:
    assert "images" not in report.pose_figure  # with --estimator truth there are none; the caption has the source


def test_the_report_says_that_baselines_are_scored_over_a_stretch_of_their_own(report: Report) -> None:
    words = "each is scored over this phase of its own run"
    assert words in report.html()
    assert words not in replace(report, scores={"seed": a_score(0.12)}).html()


def test_the_command_in_the_report_can_be_typed_again_whatever_the_task_is_called(tmp_path: Path) -> None:
    task = tmp_path / "my wipe.yaml"
    shutil.copy(Path(__file__).parents[2] / "seed_control/config/tasks/squeegee.yaml", task)
    words = ["--task", str(task), "--estimator", "truth", "--out", str(tmp_path / "out")]
    command = plan(_parser().parse_args(words)).command
    assert _parser().parse_args(shlex.split(command)[2:]).task == str(task)


def test_a_file_as_folder_of_the_results_is_refused_with_what_to_name(tmp_path: Path) -> None:
    (tmp_path / "README.md").touch()
    with pytest.raises(SeedError, match=r"README.md is a file: name a folder"):
        plan(_parser().parse_args(["--out", str(tmp_path / "README.md")]))


def test_the_share_in_the_band_is_that_of_the_stated_deviation() -> None:
    """Errors of deviation 0.3 lie within twice 0.3 for 95.4 % of the time, within twice 0.15 for 68.3 %."""
    n, rng = 20000, np.random.default_rng(3)
    force, ones = np.tile((0.0, 0.0, -10.0), (n, 1)), np.ones((n, 3))
    rows = {
        "t": np.arange(n) * 1e-3 + 5.0,
        "phase": np.zeros(n, int),
        "force": force,
        "wanted_force": force,
        "believed_force": force + 0.3 * rng.normal(size=(n, 3)),
    }
    for stated, share in ((0.3, 0.9545), (0.15, 0.6827)):
        score = score_of_belief(Recording(["wipe"], rows={**rows, "stated_force": stated * ones}), "wipe")
        assert score is not None
        assert score["in_band"] == pytest.approx(share, abs=0.01)
        assert score["error"] == pytest.approx(0.3, rel=0.03)


def test_deviations_are_turned_into_the_axes_of_the_task() -> None:
    C, R = np.diag((1.0, 4.0, 9.0)), pose_from_rpy([np.pi / 2, 0.0, 0.0], [0.0, 0.0, 0.0])[:3, :3]
    np.testing.assert_allclose(deviations(C[None], R), [[1.0, 3.0, 2.0]], atol=1e-12)


def test_bounds_are_the_worlds_own_and_a_task_that_ended_early_is_not_held(tmp_path: Path) -> None:
    score = a_score(0.7) | {"samples": 100, "torque_x": {"rmse": 0.1}}

    def held(world: str, early: str) -> bool:
        asked = plan(_parser().parse_args(["--world", world, "--out", str(tmp_path / f"{world}{len(early)}")]))
        done = _Conclusion(asked, LiveRun([], [], 1.0, early), {}, {}, None)
        done.__dict__["score"] = score
        return done.held

    assert held("hidden", "")
    assert not held("known", "")
    assert not held("hidden", "the task ended early: the track is lost")


@pytest.mark.parametrize(
    ("early", "samples", "force", "torque", "words"),
    [
        ("", 100, 0.2, 0.02, "rms off, and the force counts as held (at most 0.5 N)."),
        ("the task ended early: found no edge", 100, 0.01, 0.02, "does not count as held: the task ended early: found"),
        ("", 0, 10.0, 0.0, "so its force is not scored. The force does not count as held: nothing of 'wipe' was"),
        ("", 100, 0.7, 0.02, "not count as held: force is 0.70 N rms off (at most 0.5 N)."),
        ("", 100, 0.7, 0.1, "N rms off (at most 0.5 N), torque is 0.10 N m rms off (at most 0.08 N m)."),
    ],
)
def test_the_report_says_why_the_force_does_not_count_as_held(
    tmp_path: Path, early: str, samples: int, force: float, torque: float, words: str
) -> None:
    asked = plan(_parser().parse_args(["--world", "known", "--out", str(tmp_path)]))
    done = _Conclusion(asked, LiveRun([], [], 1.0, early), {}, {}, None)
    done.__dict__["score"] = a_score(force) | {"samples": samples, "torque_x": {"rmse": torque}}
    done.__dict__["recording"] = SimpleNamespace(contact_time=1.2)
    assert words in done._happened()
    assert done.held is ("counts as held" in words)


def test_a_hidden_world_is_drawn_from_the_seed_and_told_to_the_simulation_alone(tmp_path: Path) -> None:
    plans = [
        plan(_parser().parse_args(["--world", "hidden", "--seed", str(seed), "--out", str(tmp_path / name)]))
        for name, seed in (("a", 5), ("b", 5), ("c", 11))
    ]
    first, again, other = (load_scenario(p.scenario_name) for p in plans)
    assert plans[0].scenario_name == str(tmp_path / "a" / HIDDEN)
    assert first == again == plans[0].scenario
    assert first.grasp.kind == "membrane"
    assert first.membrane.Et != other.membrane.Et
    assert first.tool_mass != first.tool.mass
    assert first.grasp.believed is None
    assert "--world hidden" in plans[0].command
    with pytest.raises(SeedError, match="rigid_fit"):
        plan(_parser().parse_args(["--world", "hidden", "--estimator", "truth", "--out", str(tmp_path / "d")]))


def test_membranes_of_a_live_cell_are_solved_as_often_as_its_cameras_expose() -> None:
    scenario = load_scenario("membrane")
    assert at_camera_rate(scenario, 22.5).measurement.rate == 22.5
    assert at_camera_rate(scenario, 0.0) is scenario


@pytest.mark.parametrize(
    ("words", "hidden"),
    [
        ([], True),
        (["--world", "known"], False),
        (["--estimator", "truth"], False),
        (["--scenario", "slip20"], False),
        (["--task", "pen"], False),
        (["robot:=ur"], False),
        (["--task", "pen", "--world", "hidden"], True),
    ],
)
def test_a_plain_wipe_is_played_in_a_hidden_world(tmp_path: Path, words: list[str], hidden: bool) -> None:
    assert plan(_parser().parse_args([*words, "--out", str(tmp_path / "out")])).hidden is hidden


@pytest.mark.parametrize(
    ("arguments", "patience", "words"),
    [
        (("squeegee", None, 7, "nominal"), 0.0, "no baseline open loop: it took longer than 0 s"),
        (("gone", None, 7, "nominal"), 60.0, "no baseline open loop: no task 'gone'"),
        (("squeegee", None, "seven", "nominal"), 60.0, "no baseline open loop: "),  # an error that is not the suite's
    ],
)
def test_a_baseline_that_is_late_or_fails_costs_itself_alone(
    arguments: tuple[Any, ...], patience: float, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with running_baselines(("open_loop",), *arguments) as running:
        assert not finished(running, patience)
    assert words in capsys.readouterr().out


def test_a_phase_that_holds_for_long_has_the_time_for_it() -> None:
    task = load_task("squeegee")
    held = [replace(p, dwell=300.0) if p.control else p for p in task.phases]
    assert patience_with(replace(task, phases=held)) > 300.0 / 0.5  # on a machine that keeps half of real time


def test_ctrl_c_is_not_for_the_processes_of_the_baselines() -> None:
    """Each would answer it with a traceback; they end with their block."""
    before = signal.getsignal(signal.SIGINT)
    with running_baselines(("open_loop", "welded"), "squeegee", None, 7, "nominal"):
        assert signal.getsignal(signal.SIGINT) is before
        children = multiprocessing.active_children()
        ignored = [re.search(r"SigIgn:\s*(\w+)", Path(f"/proc/{c.pid}/status").read_text()) for c in children]
        assert len(ignored) == 2
        assert all(found and int(found[1], 16) >> (signal.SIGINT - 1) & 1 for found in ignored)
    assert not any(c.is_alive() for c in children)
