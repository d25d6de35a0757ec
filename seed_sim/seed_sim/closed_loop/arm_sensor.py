# SPDX-License-Identifier: Apache-2.0
"""What an arm's own force/torque sensor makes of the plant's true load: noise, an offset that drifts, a gain."""

from collections.abc import Iterator
from math import sqrt

import numpy as np

from seed_core.config import from_mapping, to_mapping
from seed_core.spatial import Wrench
from seed_core.wrench_settings import ReferenceSettings
from seed_sim.plant.plant import Plant
from seed_sim.scenario import ArmSensorSection

_WANDERS = 10.0  # [s] of drift that count as the offset's deviation after zeroing


def stated(settings: ReferenceSettings, section: ArmSensorSection) -> ReferenceSettings:
    """The checks' settings with what a data sheet would state of this sensor, where they are the defaults."""
    if not section.present:
        return settings
    data_sheet = {
        "arm_force_noise": section.force_noise,
        "arm_torque_noise": section.torque_noise,
        "arm_force_offset": _WANDERS * section.force_drift,
        "arm_torque_offset": _WANDERS * section.torque_drift,
        "arm_gain": section.gain / sqrt(3.0),  # the deviation of what is drawn evenly up to it
    }
    given, default = to_mapping(settings), to_mapping(ReferenceSettings())
    new = {name: value for name, value in data_sheet.items() if given[name] == default[name]}
    return from_mapping(given | new, ReferenceSettings, "reference")


class ArmSensor:
    """Reads the load on the flange about its origin, in E, at a rate of its own; nothing where there is no sensor."""

    def __init__(self, section: ArmSensorSection, seed: int) -> None:
        s, rng = section, np.random.default_rng([seed, 7])
        self._section, self._rng = section, rng

        def drawn(torque: float, force: float) -> np.ndarray:
            return np.array((torque,) * 3 + (force,) * 3) * rng.uniform(-1.0, 1.0, 6)

        self._zero = drawn(s.torque_zero, s.force_zero)
        self._drift = drawn(s.torque_drift, s.force_drift)  # [N m/s, N/s]
        self._gain = 1.0 + drawn(s.gain, s.gain)
        self._noise = np.array((s.torque_noise,) * 3 + (s.force_noise,) * 3)
        self._next = 0.0

    def readings(self, plant: Plant, t: float) -> Iterator[tuple[float, Wrench]]:
        """Those that are due by time t [s], at which the plant is."""
        if self._section.present and self._next <= t + 1e-9:
            self._next = max(self._next + 1.0 / self._section.rate, t)
            load = self._gain * plant.ft_wrench.vector() + self._zero + t * self._drift
            yield t, Wrench.from_vector(load + self._noise * self._rng.standard_normal(6))
