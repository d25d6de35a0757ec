# SPDX-License-Identifier: Apache-2.0
"""Figures of a benchmark: names, which end in their unit, with numbers, words or further figures."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

_PERCENTILES = {"median": 50, "p50": 50, "p99": 99, "max": 100}


def figures(name: str, samples: ArrayLike, *statistics: str) -> dict[str, float]:
    """Statistics of samples by name.

    Args:
        name: of the figures, with {} for that of the statistic: "period_{}_ms".
        samples: (n,) in that unit.
        statistics: of mean, median, p50, p99, max.
    """
    v = np.asarray(samples, dtype=float)
    return {name.format(s): float(v.mean() if s == "mean" else np.percentile(v, _PERCENTILES[s])) for s in statistics}


def text(values: Mapping[str, Any], indent: str = "  ") -> list[str]:
    """Figures as indented lines."""
    lines = []
    for key, value in values.items():
        if isinstance(value, Mapping):
            lines += [f"{indent}{key}", *text(value, indent + "  ")]
        else:
            shown = f"{value:.4g}" if isinstance(value, float) else str(value)
            lines.append(f"{indent}{key:<{max(1, 44 - len(indent))}} {shown}")
    return lines
