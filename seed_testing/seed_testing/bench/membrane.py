# SPDX-License-Identifier: Apache-2.0
"""Cost of a bubble with mechanics, per bubble and frame, while a held tool moves in six axes; CPU time on one core."""

import time

import numpy as np

from seed_core.spatial import make_pose, so3_exp
from seed_sim.membrane import MembraneGrasp, MembraneParameters
from seed_sim.tactile.parameters import ToolShape
from seed_testing.figures import figures

_RATE = 45.0  # [Hz]
_MESHES = {"fine": 0.004, "coarse": 0.007}  # [m] between nodes
_TURN, _SHIFT = 0.07, 0.002  # [rad], [m] rms of each axis


def run(frames: int = 150) -> dict[str, object]:
    """Milliseconds per bubble and frame, nodes, share of them sliding, and share of frames that settle."""
    phase = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, (2, 6))
    out: dict[str, object] = {}
    for name, spacing in _MESHES.items():
        grasp = MembraneGrasp(MembraneParameters(spacing=spacing), ToolShape())
        grasp.close()
        spent, sliding, settled = [], [], 0
        for i in range(-20, frames):
            t = (i + 20) / _RATE
            q = (np.sin(0.9 * t + phase[0]) + np.sin(2.1 * t + phase[1])) * min(1.0, 2.0 * t)
            X_CT = make_pose(so3_exp(_TURN * q[:3]), _SHIFT * q[3:])
            before = time.process_time()
            state = grasp.solve(X_CT, t)
            if i >= 0:
                spent.append(500.0 * (time.process_time() - before))
                sliding.append(state.sliding_share)
                settled += state.converged
        out[name] = {
            "nodes": len(grasp.mesh.flat),
            **figures("{}_ms", spent, "median", "p99"),
            "sliding_share": float(np.mean(sliding)),
            "settled_share": settled / frames,
        }
    return out
