# SPDX-License-Identifier: Apache-2.0
"""What the tutorials' commands leave: the triangle's plot, and the first wipe with its force."""

import tempfile
from pathlib import Path

import cv2
import numpy as np
from matplotlib import style
from matplotlib.figure import Figure

from seed_bringup.demo.figures import BLUE, INK, STYLE
from seed_bringup.pictures.gallery import wipes
from seed_bringup.pictures.scene import png
from seed_control.tasks import load_task
from seed_core.errors import FailedError
from seed_sim import evaluate
from seed_sim.closed_loop.recording import scored_phase
from seed_sim.replay.plots import run_figure

SEED = 7  # as of the commands that the pages show
PAGE = Path(__file__).resolve().parents[3] / "docs/tutorials/own_task.md"
BEGIN, END = '```yaml title="triangle.yaml"\n', "```"


def triangle() -> bytes:
    """./seed evaluate triangle.yaml --plot triangle.png, of the task that the page has."""
    if not PAGE.is_file():
        raise FailedError(f"{PAGE} is not here: this picture is drawn in a checkout")
    text = PAGE.read_text().split(BEGIN)[1].split(END)[0]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "triangle.yaml"
        file.write_text(text)
        run, phase = evaluate(str(file), seed=SEED), scored_phase(load_task(file))
    return png(run_figure(run.recording, phase, f"triangle, scenario pen, seed {SEED}, law seed"))


def first_wipe() -> bytes:
    """./seed evaluate squeegee: the cell as it wipes, and the force over time."""
    cell = cv2.imdecode(np.frombuffer(wipes(), np.uint8), cv2.IMREAD_COLOR)
    assert cell is not None
    r = evaluate("squeegee", seed=SEED).recording
    with style.context(STYLE):
        figure = Figure(figsize=(12.0, 4.0), dpi=100, layout="constrained")
        left, right = figure.subplots(1, 2)
        left.imshow(cell[..., ::-1])
        left.axis("off")
        right.plot(r["t"], -r["force"][:, 2], color=BLUE, lw=2.0, label="of the tool on the table")
        right.plot(r["t"], -r["wanted_force"][:, 2], color=INK, lw=1.0, ls=(0, (4, 3)), label="wanted")
        right.set(xlabel="time [s]", ylabel="pressing force [N]")
        right.legend(loc="lower center", fontsize=11)
        return png(figure)
