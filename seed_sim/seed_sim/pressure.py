# SPDX-License-Identifier: Apache-2.0
"""What the pressure sensors of both bubbles report, with their faults."""

from collections.abc import Mapping
from dataclasses import replace
from math import nan

import numpy as np

from seed_core.estimate import RelativePoseEstimate
from seed_sim.scenario import Scenario

_HPA = 100.0  # [Pa]


class PressureSensors:
    """Reads the true pressures; a sensor that is silent reports nothing."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        """seed: of the noise."""
        self._section, self._ambient = scenario.pressure, scenario.membrane.ambient / _HPA
        self._rng = np.random.default_rng([seed, 5])
        self._stuck: dict[str, float] = {}

    def read(self, true: Mapping[str, float], t: float) -> dict[str, float]:
        """What is told, by finger, of the true absolute pressures [hPa] at time t [s]; in hPa but for a fault."""
        s = self._section
        noise = s.noise * self._rng.standard_normal(len(true)) if s.noise > 0.0 else np.zeros(len(true))
        told = {name: value + s.offset + n for (name, value), n in zip(true.items(), noise.tolist(), strict=True)}
        if s.fault == "none" or t < s.fault_from:
            self._stuck = told
            return told
        broken = [name for name in told if not s.fault.startswith("left_") or name == "left"]
        kind = s.fault.removeprefix("left_")
        for name in broken:
            if kind == "silent":
                del told[name]
            elif kind == "stuck":
                told[name] = self._stuck.setdefault(name, told[name])
            elif kind == "pascal":
                told[name] *= _HPA
            else:
                told[name] -= self._ambient
        return told

    def into(self, estimate: RelativePoseEstimate, true: Mapping[str, float], t: float) -> RelativePoseEstimate:
        """The estimate with what the sensors report beside each membrane's motion."""
        told = self.read(true, t)
        membrane = tuple(replace(m, pressure=told.get(m.finger, nan)) for m in estimate.membrane)
        return replace(estimate, membrane=membrane)
