# SPDX-License-Identifier: Apache-2.0
"""Many pulls at many grasps, with the grip that answers slip and without: what breaks, how soon, how firm a grip."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from joblib import delayed

from seed_sim.closed_loop.progress import in_parallel
from seed_sim.gripper.pulls import KINDS, draw
from seed_sim.gripper.trial import PullOutcome, holds, necessary, run_pull


class PullScore(NamedTuple):
    """One grasp and one pull.

    Attributes:
        without: whether a grip that stays breaks. answer: what the grip that answers slip did.
        necessary: [N] the least constant grip that holds; inf: none.
    """

    kind: str
    seed: int
    without: bool
    answer: PullOutcome
    necessary: float


def score_pull(kind: str, seed: int) -> PullScore:
    """One pull, drawn from a seed, at a grasp of its own."""
    pull = draw(kind, seed)
    return PullScore(kind, seed, not holds(pull, pull.membrane.squeeze), run_pull(pull), necessary(pull))


def score(runs: int, seed: int, kinds: Sequence[str] = KINDS, jobs: int = 1) -> list[PullScore]:
    """So many pulls of each kind, the first drawn from `seed`."""
    wanted = [(kind, seed + i) for kind in kinds for i in range(runs)]
    return list(in_parallel([delayed(score_pull)(*one) for one in wanted], min(jobs, len(wanted)), "pull"))


def summary(scores: Sequence[PullScore]) -> dict[str, dict[str, float]]:
    """By kind: shares that break, milliseconds from slip's onset to more grip, grip over what was necessary."""
    return {kind: _of([s for s in scores if s.kind == kind]) for kind in dict.fromkeys(s.kind for s in scores)}


def _of(cases: Sequence[PullScore]) -> dict[str, float]:
    answers = [c.answer for c in cases]
    delays = [1e3 * max(a.more - a.onset, 0.0) for a in answers if np.isfinite(a.onset)]
    shares = [c.answer.grip / c.necessary for c in cases if np.isfinite(c.necessary)]
    slid = [1e3 * a.slid for a in answers if not a.broken]
    return {
        "runs": len(cases),
        "broken_without": float(np.mean([c.without for c in cases])),
        "broken_with": float(np.mean([a.broken for a in answers])),
        "held": float(np.mean([bool(a.reason) for a in answers])),
        "onset_to_grip_ms_median": float(np.median(delays)) if delays else 0.0,
        "onset_to_grip_ms_most": float(np.max(delays)) if delays else 0.0,
        "onset_to_grip_within_50_ms": float(np.mean(np.array(delays) <= 50.0)) if delays else 1.0,
        "grip_over_necessary_mean": float(np.mean(shares)) if shares else float("nan"),
        "grip_over_necessary_most": float(np.max(shares)) if shares else float("nan"),
        "slid_mm_mean": float(np.mean(slid)) if slid else float("nan"),
    }


def table(result: dict[str, dict[str, float]]) -> str:
    """The summary for people."""
    lines = [
        f"{'':10}{'runs':>5}{'breaks without':>16}{'with':>7}{'held':>7}{'onset to grip [ms]':>20}"
        f"{'grip / necessary':>18}{'slid [mm]':>11}",
        f"{'':10}{'':5}{'':16}{'':7}{'':7}{'median':>12}{'most':>8}{'mean':>11}{'most':>7}{'mean':>11}",
    ]
    for kind, r in result.items():
        lines.append(
            f"{kind:10}{r['runs']:5.0f}{100 * r['broken_without']:14.0f} %{100 * r['broken_with']:5.0f} %"
            f"{100 * r['held']:5.0f} %{r['onset_to_grip_ms_median']:12.0f}{r['onset_to_grip_ms_most']:8.0f}"
            f"{r['grip_over_necessary_mean']:11.2f}{r['grip_over_necessary_most']:7.2f}{r['slid_mm_mean']:11.1f}"
        )
    return "\n".join(lines)


def told(cases: Sequence[PullScore]) -> list[dict[str, Any]]:
    """Every run by itself."""
    return [
        {"kind": c.kind, "seed": c.seed, "broken_without": c.without, "necessary": c.necessary}
        | {k: v for k, v in c.answer._asdict().items() if k != "moments"}
        for c in cases
    ]
