# SPDX-License-Identifier: Apache-2.0
"""The README's picture, from the headless evaluation: python -m seed_bringup.demo.picture docs/images/demo.svg"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from seed_bringup.demo.figures import Phase, force_and_torque
from seed_sim.closed_loop.evaluate import run
from seed_sim.closed_loop.recording import SETTLING

SEED = 11


def picture(estimator: str = "rigid_fit") -> str:
    """SVG of force and torque of one wipe, with both baselines."""
    runs, phases, band = {}, [], (0.0, 0.0)
    for name, law in (("SEED", "seed"), ("open loop", "open_loop"), ("welded", "welded")):
        recording = run("squeegee", law=law, estimator=estimator, seed=SEED, force=10.0).run.recording
        t = np.array(recording["t"])
        runs[name] = (t, -recording["force"][:, 2], recording["torque_T"][:, 0])
        if law == "seed":
            index = np.array(recording["phase"])
            phases = [
                Phase(p, float(t[index == i][0]), float(t[index == i][-1]))
                for i, p in enumerate(recording.phases)
                if (index == i).any()
            ]
            wipe = next(p for p in phases if p.name == "wipe")
            band = (max(wipe.start, (recording.contact_time or 0.0) + SETTLING), wipe.end)
    return force_and_torque(runs, 10.0, band, phases)


def main() -> int:
    """Write the picture."""
    svg = picture().replace("<svg", '<svg style="background:#fff"', 1)
    Path(sys.argv[1]).write_text(f'<?xml version="1.0"?>\n{svg}', encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
