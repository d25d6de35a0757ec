# SPDX-License-Identifier: Apache-2.0
"""Cost of a bubble with mechanics, per bubble and frame, while a held tool moves in six axes; CPU time on one core.

python -m seed_testing.bench.membrane [FIRST [COUNT [SPACING [SCALE]]]] holds four tools by COUNT random membranes,
with the motion SCALE times as large, and prints for each tool what settles, what slides, and the time.
"""

import sys
import time
from typing import Any

import numpy as np

from seed_core.spatial import Array, make_pose, so3_exp
from seed_sim.membrane import MembraneGrasp, MembraneParameters, random_membrane
from seed_sim.tactile.parameters import ToolShape
from seed_testing.figures import figures

_RATE = 45.0  # [Hz]
_MESHES = {"fine": 0.004, "coarse": 0.007}  # [m] between nodes
_TURN, _SHIFT = np.radians(4.0), 0.002  # [rad], [m] rms of each axis
_FREQUENCIES = (0.12, 0.31)  # [Hz]
TOOLS = {
    "box": ToolShape("box"),
    "long cylinder": ToolShape(),
    "marker": ToolShape("marker", radius=0.008, length=0.14),
    "thin, 6 mm": ToolShape(radius=0.006),
}


def motion(seed: int, frames: int, rate: float = _RATE, scale: float = 1.0) -> list[Array]:
    """Poses X_CT (4, 4): in each axis two sines of random phase and nearly the frequencies above, from the grasp on."""
    rng = np.random.default_rng(seed)
    t = np.arange(1, frames + 1)[:, None] / rate
    q = np.zeros((frames, 6))
    for frequency in _FREQUENCIES:
        q += np.sin(2.0 * np.pi * frequency * (1.0 + rng.uniform(-0.3, 0.3, 6)) * t + rng.uniform(0.0, 2.0 * np.pi, 6))
    q *= scale * np.minimum(1.0, t)
    return [make_pose(so3_exp(_TURN * row[:3]), _SHIFT * row[3:]) for row in q]


def follow(grasp: MembraneGrasp, poses: list[Array], rate: float = _RATE) -> dict[str, Any]:
    """CPU milliseconds per bubble, share of nodes that slide and of frames that settle, along a path."""
    spent, sliding, settled = [], [], []
    for i, X_CT in enumerate(poses, start=1):
        before = time.process_time()
        state = grasp.solve(X_CT, i / rate)
        spent.append(500.0 * (time.process_time() - before))
        sliding.append(state.sliding_share)
        settled.append(state.converged)
    return {"ms": spent, "sliding": sliding, "settled": settled}


def run(frames: int = 150) -> dict[str, object]:
    """Milliseconds per bubble and frame, nodes, share of them sliding, and share of frames that settle."""
    out: dict[str, object] = {}
    for name, spacing in _MESHES.items():
        grasp = MembraneGrasp(MembraneParameters(spacing=spacing), TOOLS["long cylinder"])
        grasp.close()
        path = follow(grasp, motion(0, frames + 20))
        out[name] = {
            "nodes": len(grasp.mesh.flat),
            **figures("{}_ms", path["ms"][20:], "median", "p99"),
            "sliding_share": float(np.mean(path["sliding"][20:])),
            "settled_share": float(np.mean(path["settled"][20:])),
        }
    return out


def main(first: int = 0, count: int = 10, spacing: float = 0.008, scale: float = 1.0) -> None:
    """Random membranes `first` to `first + count` on every tool, 8 s at 15 Hz each."""
    for name, tool in TOOLS.items():
        paths = []
        for seed in range(first, first + count):
            grasp = MembraneGrasp(random_membrane(seed, spacing), tool)
            grasp.close()
            paths.append(follow(grasp, motion(seed, 120, 15.0, scale), 15.0))
        settled, sliding, ms = (np.concatenate([p[key] for p in paths]) for key in ("settled", "sliding", "ms"))
        print(
            f"{name}: {settled.size - settled.sum():.0f} of {settled.size} frames unsettled, "
            f"{sliding.mean():.0%} sliding, {np.median(ms):.1f} ms ({np.quantile(ms, 0.99):.1f} at 99 %)",
            flush=True,
        )


if __name__ == "__main__":
    words = sys.argv[1:]
    main(*(int(w) for w in words[:2]), *(float(w) for w in words[2:]))
