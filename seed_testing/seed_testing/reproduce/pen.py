# SPDX-License-Identifier: Apache-2.0
"""Strokes of a simulated felt-tip pen, and what they leave on paper: width and darkness by the force on the tip.

A model, not a measurement. The tip is a soft ball on a hard plane (Hertz): its contact circle has the radius
a = (3 F R / (4 E))^(1/3), and the line is as wide as the circle. Ink flows with the mean pressure under the tip and
saturates: darkness = 1 - exp(-p / p0), p = F / (pi a^2).
"""

from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seed_core.spatial import Array
from seed_sim.closed_loop.recording import Recording

TIP_RADIUS = 0.75e-3  # R [m]: a marker with a round tip of 1.5 mm
TIP_MODULUS = 5.0e6  # E [Pa]: felt, on hard paper
INK_PRESSURE = 1.0e6  # p0 [Pa] at which the line has 63 % of full darkness
_RAMP = 0.5  # [s] at the start of a stroke that statistics leave out


def stroke_width(force: ArrayLike) -> Array:
    """Width [m] of the line under each force [N]; zero where the pen does not press."""
    F = np.maximum(np.asarray(force, dtype=float), 0.0)
    return np.asarray(2.0 * np.cbrt(3.0 * F * TIP_RADIUS / (4.0 * TIP_MODULUS)))


def darkness(force: ArrayLike) -> Array:
    """0 (blank) to 1 (saturated) under each force [N]."""
    F = np.maximum(np.asarray(force, dtype=float), 0.0)
    width = stroke_width(F)
    area = np.where(F > 0.0, 0.25 * pi * width**2, 1.0)
    return np.asarray(1.0 - np.exp(-F / area / INK_PRESSURE))


@dataclass(frozen=True)
class Stroke:
    """One stroke: tip (n, 2) and reference (n, 2) [m] on the paper, force onto it (n,) [N], commanded force [N]."""

    name: str
    t: Array
    tip: Array
    reference: Array
    force: Array
    commanded: float

    def statistics(self) -> dict[str, float]:
        """Force error, width of the line and path error, from half a second after the stroke's start."""
        keep = self.t > self.t[0] + _RAMP if self.t[-1] - self.t[0] > 2 * _RAMP else np.ones(len(self.t), bool)
        force, off = self.force[keep], (self.tip - self.reference)[keep]
        width = 1e3 * stroke_width(force)
        return {
            "commanded": self.commanded,
            "force_mean": float(force.mean()),
            "force_rmse": float(np.sqrt(np.mean((force - self.commanded) ** 2))),
            "width_mm_mean": float(width.mean()),
            "width_mm_std": float(width.std()),
            "width_mm_commanded": float(1e3 * stroke_width(self.commanded)),
            "path_rmse_mm": float(1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1)))),
        }


def strokes_of(recording: Recording) -> list[Stroke]:
    """All phases named '... draw', in order; those that were never reached are left out."""
    out, phase = [], recording["phase"]
    tip, reference, force = recording["tip"][:, :2], recording["reference"][:, :2], -recording["force"][:, 2]
    for i, name in enumerate(recording.phases):
        keep = phase == i
        if name.endswith(" draw") and keep.sum() > 1:
            wanted = float(np.linalg.norm(recording["wanted_force"][keep][-1]))
            out.append(Stroke(name, recording["t"][keep], tip[keep], reference[keep], force[keep], wanted))
    return out


def draw_strokes(axis: Any, strokes: list[Stroke], title: str, reference: bool = False) -> None:
    """The strokes as the pen model leaves them, to scale, on an axis in millimetres."""
    from matplotlib.collections import PolyCollection

    for stroke in strokes:
        quads, shades = _ribbon(stroke)
        colours = np.zeros((len(quads), 4))
        colours[:, 2], colours[:, 3] = 0.35, shades
        axis.add_collection(PolyCollection(quads, facecolors=colours, edgecolors="none"))
        if reference:
            axis.plot(*(1e3 * stroke.reference.T), color="tab:red", lw=0.5)
    axis.set_aspect("equal")
    axis.autoscale_view()
    axis.set_title(title, fontsize="small")
    axis.set_xlabel("x [mm]")
    axis.set_ylabel("y [mm]")


def _ribbon(stroke: Stroke) -> tuple[list[Array], Array]:
    """Quadrilaterals (4, 2) [mm] between samples, as wide as the line, and their darkness."""
    moved = np.concatenate([[True], np.linalg.norm(np.diff(stroke.tip, axis=0), axis=1) > 2e-5])
    tip, force = 1e3 * stroke.tip[moved], stroke.force[moved]
    if len(tip) < 2:
        return [], np.zeros(0)
    along = np.gradient(tip, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    half = 0.5e3 * stroke_width(force)[:, None] * normal
    left, right = tip + half, tip - half
    quads = [np.array((left[i], left[i + 1], right[i + 1], right[i])) for i in range(len(tip) - 1)]
    return quads, darkness(0.5 * (force[1:] + force[:-1]))
