# SPDX-License-Identifier: Apache-2.0
"""Identification of the stiffness of a compliant grasp (Sec. VI of the paper).

from seed_sysid import analyse, read_dataset

analysis = analyse(read_dataset("samples.jsonl"), "kinematic")
print(analysis.solution.value.stiffness)  # (grips, 6) [N m/rad, N/m]
print(analysis.solution.half_width)  # of their 95 % intervals
"""

from seed_sysid.data.dataset import Dataset, DatasetError, Header, Sample
from seed_sysid.data.sample_file import read as read_dataset
from seed_sysid.fit.analysis import Analysis, analyse
from seed_sysid.fit.identification_fit import Solution, fit_stiffness
from seed_sysid.fit.load_model import Problem, Unknowns
from seed_sysid.fit.weight import WeightFit, fit_weight
from seed_sysid.parameters import FitParameters, Procedure
from seed_sysid.report.summary import stiffness_file, summary
from seed_sysid.run.procedure import Command, Reading, Run

__all__ = [
    "Analysis",
    "Command",
    "Dataset",
    "DatasetError",
    "FitParameters",
    "Header",
    "Problem",
    "Procedure",
    "Reading",
    "Run",
    "Sample",
    "Solution",
    "Unknowns",
    "WeightFit",
    "analyse",
    "fit_stiffness",
    "fit_weight",
    "read_dataset",
    "stiffness_file",
    "summary",
]
