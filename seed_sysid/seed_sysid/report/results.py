# SPDX-License-Identifier: Apache-2.0
"""The files that an identification leaves: stiffness.yaml, summary.json and report.html."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from seed_core.stiffness_file import save_stiffness
from seed_sysid.fit.analysis import Analysis
from seed_sysid.report.html_report import render
from seed_sysid.report.summary import stiffness_file


def write_results(folder: Path, a: Analysis, figures: dict[str, Any], date: str) -> None:
    """Write all three; a stiffness.yaml that is there already is kept as stiffness.previous.yaml.

    Args:
        folder: made if it is not there.
        a: the analysis.
        figures: its summary, with what else is known (the truth, the clocks).
        date: ISO 8601.

    Raises:
        DatasetError: an axis is undetermined; nothing is written then.
    """
    result = stiffness_file(a, date)
    folder.mkdir(parents=True, exist_ok=True)
    stiffness = folder / "stiffness.yaml"
    if stiffness.exists():
        stiffness.replace(stiffness.with_suffix(".previous.yaml"))
    save_stiffness(stiffness, result)
    (folder / "summary.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    part = folder / "report.html.part"
    part.write_text(render(a, figures), encoding="utf-8")
    part.replace(folder / "report.html")
