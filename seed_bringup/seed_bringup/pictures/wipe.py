# SPDX-License-Identifier: Apache-2.0
"""The README's picture, from the headless evaluation.

python -m seed_bringup.pictures.wipe docs/images/demo.svg
"""

import sys
from pathlib import Path

from seed_bringup.demo.figures import force_and_torque
from seed_bringup.demo.score import Phase, curve_of, scored_stretches
from seed_sim import evaluate

SEED, FORCE = 11, 10.0  # [1], [N]


def picture(estimator: str = "rigid_fit") -> str:
    """SVG of force and torque of one wipe, with both baselines."""
    runs = {
        name: evaluate("squeegee", law=law, estimator=estimator, seed=SEED, force=FORCE).recording
        for name, law in (("SEED", "seed"), ("open loop", "open_loop"), ("welded", "welded"))
    }
    own = runs["SEED"]
    times = {name: own["t"][own["phase"] == i] for i, name in enumerate(own.phases)}
    phases = [Phase(name, float(t[0]), float(t[-1])) for name, t in times.items() if t.size]
    scored = scored_stretches(phases, "wipe", own.contact_time or 0.0)
    return force_and_torque({name: curve_of(recording) for name, recording in runs.items()}, FORCE, scored, phases)


if __name__ == "__main__":
    svg = picture().replace("<svg", '<svg style="background:#fff"', 1)
    Path(sys.argv[1]).write_text(f'<?xml version="1.0"?>\n{svg}', encoding="utf-8")
