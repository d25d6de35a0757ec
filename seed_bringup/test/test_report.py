# SPDX-License-Identifier: Apache-2.0
"""The report of a run opens without a network and says what the numbers say."""

import multiprocessing
import re
import signal
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from seed_bringup.demo.baselines import running_baselines
from seed_bringup.demo.figures import force_and_torque, relative_pose
from seed_bringup.demo.report import Picture, Report, text_table
from seed_bringup.demo.score import Curve, Phase
from seed_bringup.demo.series import Series
from seed_core.spatial import pose_from_rpy

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
        force_figure=force_and_torque({"SEED": run, "open loop": run}, 10.0, (3.0, 6.0), phases),
        pose_figure=relative_pose(poses, poses, phases),
        pictures=[Picture(PNG, "press")],
        details={"command": "./seed demo"},
        replay="replay.html",
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
