# SPDX-License-Identifier: Apache-2.0
"""hysteretic_spring.yaml gives back the spring that was written, and refuses what is none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seed_core.config import ConfigError
from seed_core.hysteretic.file import hysteretic_file, load_hysteretic, save_hysteretic
from seed_core.hysteretic.spring import HystereticStiffness


def spring() -> HystereticStiffness:
    rng = np.random.default_rng(4)
    root = rng.normal(size=(6, 4, 4))
    return HystereticStiffness(
        stiffness=rng.uniform(3.0, 900.0, 6),
        rise=rng.normal(size=6),
        yields=rng.uniform(0.001, 0.1, (2, 6)),
        friction=rng.uniform(0.0, 0.5, (2, 6)),
        covariance=root @ root.transpose(0, 2, 1),
        residual=rng.uniform(0.0, 0.1, 6),
        largest=rng.uniform(0.005, 0.2, 6),
        centre=np.array((0.001, -0.002, 0.003)),
    )


def test_a_spring_comes_back_from_its_file(tmp_path: Path) -> None:
    written, file = spring(), tmp_path / "hysteretic_spring.yaml"
    save_hysteretic(file, hysteretic_file(written, "hand", "tool", "2026-01-01", 1030.0, 0.02))
    read = load_hysteretic(file)
    assert (read.hand, read.tool, read.pressure_hpa, read.width_m) == ("hand", "tool", 1030.0, 0.02)
    for name in ("stiffness", "rise", "yields", "friction", "covariance", "residual", "largest", "centre"):
        np.testing.assert_allclose(getattr(read.identified, name), getattr(written, name), rtol=1e-12)


def test_axes_out_of_order_or_of_other_sizes_are_refused() -> None:
    file = hysteretic_file(spring(), "hand", "tool", "2026-01-01", 1030.0, 0.02)
    with pytest.raises(ConfigError, match="in this order"):
        replace(file, axes=file.axes[::-1])
    with pytest.raises(ConfigError, match="axis roll: 2 yields need 2 values of friction and 16"):
        replace(file.axes[0], covariance=file.axes[0].covariance[:-1])
