# SPDX-License-Identifier: Apache-2.0
"""What an arm did after a fault, from its track: when it stood, how far and how fast it went; is that well?"""

from collections.abc import Sequence
from math import nan
from typing import Any, NamedTuple

import numpy as np

from seed_core.spatial import Array

STANDS = 0.003  # [m/s] an arm slower than this stands still, noise of a loaded machine's stamps included
OVER = 0.04  # [s] over which speed is taken
HELD_WITHIN = 0.2  # [s]
UNASKED = 0.002  # [m] of motion that is none
EXCESS = 5.0  # [N] of true force above what was wanted
MOVES = ("press", "wipe", "lift")  # phases in which the arm is in motion
THE_ARM = {("sim", "sim"), ("ur", "ur_controller")}  # robot and node that is the arm: its end leaves nothing to see


class Motion(NamedTuple):
    """Of an arm after a fault."""

    held_after: float  # [s] until it stood for good; nan: not seen
    travel: float  # [m] from where it was at the fault
    late_travel: float  # [m] of that after the bound
    speed: float  # [m/s] the largest
    blind: float  # [s] longest time in which it was not seen


def motion(times: Sequence[float], places: Sequence[Array], fault: float, until: float) -> Motion:
    """From a track: times (n,) [s] that rise, places (n, 3) [m], between a fault and `until` [s]."""
    t, p = np.asarray(times, dtype=float), np.asarray(places, dtype=float).reshape(-1, 3)
    keep = (t >= fault - OVER) & (t <= until)
    t, p = t[keep], p[keep]
    blind = float(np.diff([fault, *t[t >= fault], until]).max())
    if len(t) < 5 or t[-1] < fault + HELD_WITHIN:
        return Motion(nan, nan, nan, nan, blind)
    before = np.searchsorted(t, t - OVER).clip(0, None)
    whole = (before < np.arange(len(t))) & (t - t[0] >= 0.5 * OVER)
    speed = np.zeros(len(t))
    speed[whole] = np.linalg.norm(p - p[before], axis=1)[whole] / (t - t[before])[whole]
    after = t >= fault
    fast = after & (speed > STANDS)
    held = max(float(t[fast][-1]) - fault - 0.5 * OVER, 0.0) if fast.any() else 0.0
    way = np.linalg.norm(p - p[np.argmax(after)], axis=1)
    late = t >= fault + HELD_WITHIN
    slid = np.linalg.norm(p[late] - p[late][0], axis=1).max() if late.any() else nan
    return Motion(held, float(way[after].max()), float(slid), float(speed[after].max()), blind)


def moved_on(times: Sequence[float], places: Sequence[Array], since: float) -> str:
    """Whether an arm moved after it stood, in words: times (n,) [s], places (n, 3) [m], since then [s].

    An arm that was away meanwhile, its node having ended, begins where it is seen first.
    """
    later = [p for t, p in zip(times, places, strict=True) if t > since]
    way = max((float(np.linalg.norm(p - later[0])) for p in later), default=0.0)
    return f"moved on by {1e3 * way:.1f} mm without a request" if way > UNASKED else ""


def faults_of(row: dict[str, Any]) -> list[str]:
    """What is wrong with a case, in words; nothing when it is well."""
    found = []
    if row["blind_s"] > HELD_WITHIN and (row["robot"], row["node"]) not in THE_ARM:
        found.append(f"not seen for {row['blind_s']:.2f} s")
    held = row["held_after_s"]
    if held is not None and held > HELD_WITHIN and row["late_travel_mm"] > 1e3 * UNASKED:
        found.append(f"held after {held:.2f} s, {row['late_travel_mm']:.1f} mm later than {HELD_WITHIN:g} s")
    if row["phase"] not in MOVES and row["travel_mm"] is not None and row["travel_mm"] > 1e3 * UNASKED:
        found.append(f"moved by {row['travel_mm']:.1f} mm while nothing was asked")
    if row["force_n"] is not None and row["force_n"] > row["wanted_n"] + EXCESS:
        before = row["force_before_n"]
        found.append(f"true force {row['force_n']:.1f} N" + (f", {before:.1f} N before the fault" if before else ""))
    if row["resumed_unasked"]:
        found.append(row["resumed_unasked"])
    if row["needs_cause"] and not row["state"]:
        found.append("no cause in the state")
    if row["needs_cause"] and not row["diagnostics"]:
        found.append("no cause in the diagnostics")
    if row["recovered"] is False:  # None: it was not tried
        found.append("did not recover")
    return found
