# SPDX-License-Identifier: Apache-2.0
"""Fig. 4: relative pose of a long cylinder, truth and the estimates of both methods, over all six axes."""

from pathlib import Path

from seed_core.program.command_line import to_json
from seed_estimation import METHODS
from seed_sim import load_scenario
from seed_testing.validation.figure import draw
from seed_testing.validation.run import FOLDERS, run
from seed_testing.validation.scores import scores

SCENARIO = "long_cylinder"


def reproduce(folder: Path, seed: int) -> tuple[str, list[Path]]:
    """Run both methods on the same images. Returns a title and the files."""
    scenario = load_scenario(SCENARIO, *FOLDERS)
    runs = {method: run(scenario, method, seed) for method in sorted(METHODS)}
    numbers = folder / "fig4.json"
    numbers.write_text(to_json({m: scores(series) for m, series in runs.items()}, indent=2) + "\n", encoding="utf-8")
    files = [draw(runs, folder / "fig4.png", "long cylinder along z"), numbers]
    return "Fig. 4: relative pose, truth and estimates", files
