# SPDX-License-Identifier: Apache-2.0
"""What the environment looks like from the side: table, clean cells, tool, and the force beside the wanted one."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_sim.learning.episode import Episode
from seed_sim.learning.strip import CELLS, FORCE, LENGTH, Strip

WIDTH, HEIGHT = 480, 240
_SCALE = 1200.0  # [pixels/m]
_ORIGIN = (70, 190)  # pixel of the task frame
_INK, _PAPER, _CLEAN, _DIRTY, _TOOL = (40, 40, 40), (250, 250, 250), (120, 190, 120), (200, 170, 130), (60, 90, 170)


def _pixel(x: float, z: float) -> tuple[int, int]:
    return round(_ORIGIN[0] + _SCALE * x), round(_ORIGIN[1] - _SCALE * z)


def picture(episode: Episode, strip: Strip) -> NDArray[np.uint8]:
    """(HEIGHT, WIDTH, 3) RGB."""
    out: Any = np.full((HEIGHT, WIDTH, 3), _PAPER, np.uint8)
    surface = np.linalg.inv(episode.X_work) @ episode.plant.surface.X_WS
    normal, origin = surface[:3, 2], surface[:3, 3]

    def ground(x: float) -> float:  # [m] height of the table in the task frame, at y = 0
        return float(origin[2] - (normal[0] * (x - origin[0]) - normal[1] * origin[1]) / normal[2])

    for i, clean in enumerate(strip.clean):
        ends = [LENGTH * j / CELLS for j in (i, i + 1)]
        top = [_pixel(x, ground(x)) for x in ends]
        below = [(u, v + 10) for u, v in reversed(top)]
        cv2.fillPoly(out, [np.array(top + below, np.int32)], _CLEAN if clean else _DIRTY)
    cv2.line(out, _pixel(-0.05, ground(-0.05)), _pixel(0.33, ground(0.33)), _INK, 1, cv2.LINE_AA)
    tip, tool = episode.tip_true, np.linalg.inv(episode.X_work) @ episode.plant.X_WT
    cv2.line(out, _pixel(tip[0], tip[2]), _pixel(tool[0, 3], tool[2, 3]), _TOOL, 4, cv2.LINE_AA)
    cv2.circle(out, _pixel(tool[0, 3], tool[2, 3]), 9, _TOOL, -1, cv2.LINE_AA)
    u, full = WIDTH - 40, 150.0
    for force, color, at in ((episode.pressing_force, _TOOL, u), (FORCE, _INK, u + 14)):
        top_v = round(_ORIGIN[1] - full * min(max(force, 0.0) / (1.5 * FORCE), 1.0))
        cv2.rectangle(out, (at, top_v), (at + 10, _ORIGIN[1]), color, -1)
    text = (
        f"t {episode.time:5.2f} s   force {episode.pressing_force:5.2f} N of {FORCE:g}   clean {strip.clean.mean():.0%}"
    )
    cv2.putText(out, text, (12, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
    if episode.failure:
        cv2.putText(out, episode.failure[:70], (12, 42), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (180, 40, 40), 1, cv2.LINE_AA)
    return np.asarray(out, np.uint8)
