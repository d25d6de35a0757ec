# SPDX-License-Identifier: Apache-2.0
"""Scores of one run, from the plant's own forces: from first contact on and over the whole wipe, nothing left out."""

import numpy as np

from seed_core.spatial import Array
from seed_sim.closed_loop.recording import CONTACT_FORCE, Recording, rms

IMPACT = 0.9, 0.3  # share of the wanted force, and [s] after it is first reached until which its peak is looked for
REST = 0.1, 0.3  # share of the wanted force, and [N], within which it has come to rest
LOST = 0.02  # share of the wanted force below which contact counts as lost

SCORES = {
    "rms": ("force error, rms over the wipe", "N"),
    "p90": ("force error that 90 % of the wipe keep", "N"),
    "press_rms": ("force error, rms from first contact to the wipe", "N"),
    "peak": ("largest force at contact, over the wanted one", "N"),
    "overshoot": ("largest force before the wipe, over the wanted one", "%"),
    "rest": ("from first contact to rest", "s"),
    "bandwidth": ("of force: 0.35 / rise time of a step", "Hz"),
    "lean": ("rotation off the path, rms over the wipe", "deg"),
    "torque": ("torque along the blade, rms over the wipe", "N m"),
    "lost": ("times that contact was lost", ""),
}
LARGER_IS_BETTER = ("bandwidth",)
OF_STEPS, OF_WIPES = ("bandwidth",), ("lean", "torque")  # scores that only such cases have


def scores_of(recording: Recording, force: float) -> dict[str, float | None]:
    """By the names of SCORES, in their units; None where there is nothing to score. force: [N] wanted.

    A run that did not finish has the whole wanted force as its error, or its error until then if that is more.
    """
    t, phase = recording["t"], recording["phase"]
    pressed, wanted = -recording["force"][:, 2], -recording["wanted_force"][:, 2]
    touching = np.flatnonzero((pressed > CONTACT_FORCE) & (wanted > 0.0))
    out: dict[str, float | None] = dict.fromkeys(SCORES)
    if not len(touching):
        return out | {"rms": force, "p90": force}
    since = t >= t[touching[0]]
    named = {name: phase == i for i, name in enumerate(recording.phases)}
    press, wipe = named["press"] & since, named.get("wipe", np.zeros(len(t), bool)) & since
    steps = [named[n] for n in recording.phases if n.startswith("step ") and named[n].any()]
    working = wipe if wipe.any() or not steps else np.logical_or.reduce(steps)
    error = pressed - wanted
    if press.any():
        out |= _of_press(t[press], pressed[press], force)
    if not working.any():
        return out | {"rms": force, "p90": force}
    mean, most = rms(error[working]), float(np.percentile(np.abs(error[working]), 90))
    if not recording.finished:
        return out | {"rms": max(mean, force), "p90": max(most, force)}
    out |= {"rms": mean, "p90": most}
    if steps:
        rises = [_rise(t[s], pressed[s], wanted[s]) for s in steps]
        out["bandwidth"] = float(np.median([0.35 / r for r in rises]))
    else:
        held = [i for i in range(3) if not recording.torque_axes[i]]
        out["lean"] = rms(np.rad2deg(np.linalg.norm(recording["lean"][wipe][:, held], axis=1)))
        out["torque"] = rms(recording["torque_T"][wipe][:, 0])
    out["lost"] = float(_lost(pressed[press | working], force))
    return out


def _of_press(t: Array, pressed: Array, force: float) -> dict[str, float | None]:
    away = np.abs(pressed - force) > max(REST[0] * force, REST[1])
    late = np.flatnonzero(away)
    at_rest = not len(late) or late[-1] + 1 < len(t)
    reached = np.flatnonzero(pressed >= IMPACT[0] * force)
    peak = overshoot = None  # of a press that does not reach its force
    if len(reached):
        peak = float(max(pressed[t <= t[reached[0]] + IMPACT[1]].max() - force, 0.0))
        overshoot = float(max(100.0 * (pressed.max() / force - 1.0), 0.0))
    return {
        "press_rms": rms(pressed - force),
        "peak": peak,
        "overshoot": overshoot,
        "rest": float(t[late[-1] + 1] - t[0] if len(late) else 0.0) if at_rest else None,
    }


def _rise(t: Array, pressed: Array, wanted: Array) -> float:
    """From 10 to 90 % of a step [s]; all of its time where it does not get there."""
    start, end = pressed[0], wanted[-1]
    share = (pressed - start) / (end - start)
    first, last = np.flatnonzero(share > 0.1), np.flatnonzero(share > 0.9)
    return float(t[last[0]] - t[first[0]]) if len(last) and last[0] > first[0] else float(t[-1] - t[0])


def _lost(pressed: Array, force: float) -> int:
    """How often contact was lost after it was made."""
    made = np.flatnonzero(pressed > 0.5 * force)
    if not len(made):
        return 0
    off = pressed[made[0] :] < LOST * force
    return int((off[1:] & ~off[:-1]).sum())
