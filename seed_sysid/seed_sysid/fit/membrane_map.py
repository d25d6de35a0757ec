# SPDX-License-Identifier: Apache-2.0
"""The membrane map of an identification, beside its stiffness: found, or refused with the reason."""

from dataclasses import dataclass

from seed_core.config import ConfigError
from seed_core.membrane.map_file import MembraneMapFile
from seed_core.spatial import Array
from seed_sysid.data.dataset import Dataset, DatasetError
from seed_sysid.fit.identification_fit import Solution
from seed_sysid.fit.load_model import Problem
from seed_sysid.membrane.data import has_membranes, membrane_data
from seed_sysid.membrane.fit import MembraneFit, fit_without_outliers
from seed_sysid.membrane.result import (
    causes,
    compare_models,
    curvature,
    map_file,
    refuse_unexcited,
    remaining_hysteresis,
)
from seed_sysid.membrane.terms import DEFAULT_MODEL
from seed_sysid.stiffness_map import stiffness_map


@dataclass(frozen=True)
class MembraneResult:
    """A map and what is to be known about it; `file` has no date yet.

    Attributes:
        shares: (6,) by model, what each leaves unexplained of samples that it did not see.
        remarks: what hysteresis and curvature are due to, in words.
    """

    fit: MembraneFit
    file: MembraneMapFile
    shares: dict[str, Array]
    remarks: tuple[str, ...]


def membrane_result(data: Dataset, problem: Problem, solution: Solution) -> tuple[MembraneResult | None, str]:
    """The map, or why there is none; neither where no sample tells of membranes."""
    if not has_membranes(data):
        return None, ""
    try:
        fit, outliers = fit_without_outliers(membrane_data(data), DEFAULT_MODEL)
        refuse_unexcited(fit)
        file = map_file(fit, data.header.hand, data.header.tool, data.header.created)
    except (DatasetError, ConfigError) as error:
        return None, str(error)
    shares = compare_models(fit)
    found = [f"outliers left out of the membrane map: {outliers}"] if outliers else []
    if fit.data.lost:
        found.append(f"without motion of the membranes, left out of their map: {', '.join(fit.data.lost)}")
    kept = fit.data.kept
    B = stiffness_map(problem.X_TC[kept], problem.parameters.model).B
    remaining = remaining_hysteresis(fit, B, problem.z[kept])
    found += causes(problem.hysteretic, solution.value.friction, remaining)
    return MembraneResult(fit, file, shares, (*found, *curvature(shares))), ""
