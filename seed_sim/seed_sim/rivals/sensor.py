# SPDX-License-Identifier: Apache-2.0
"""What wrist sensors and joint torques tell of the load: noise, what zeroing leaves, drift, gain, delay."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from seed_core.config import field
from seed_core.spatial import Array


@dataclass(frozen=True)
class ForceSensor:
    """A six-axis reading after it was zeroed in free space, right before the task."""

    name: str = field("ideal", doc="which")
    rate: float = field(1000.0, unit="Hz", low=10.0, high=10000.0, doc="of the readings")
    delay: float = field(0.0, unit="s", low=0.0, high=0.1, doc="until a reading is at hand")
    force_noise: float = field(0.0, unit="N", low=0.0, high=10.0, doc="white, per axis and reading")
    torque_noise: float = field(0.0, unit="N m", low=0.0, high=1.0, doc="likewise")
    force_offset: float = field(0.0, unit="N", low=0.0, high=10.0, doc="deviation of what is left after zeroing")
    torque_offset: float = field(0.0, unit="N m", low=0.0, high=1.0, doc="likewise")
    force_drift: float = field(0.0, unit="N/s", low=0.0, high=1.0, doc="of the offset, drawn up to this")
    torque_drift: float = field(0.0, unit="N m/s", low=0.0, high=0.1, doc="likewise")
    gain: float = field(0.0, low=0.0, high=0.5, doc="error of each axis' gain, drawn up to this")


IDEAL = ForceSensor()
"""Nobody can buy it: the bound of what any sensor at the wrist could do."""

UR_E_SERIES = ForceSensor(
    name="UR e-series",
    rate=500.0,
    delay=0.002,
    force_noise=0.3,
    torque_noise=0.03,
    force_offset=0.48,
    torque_offset=0.036,
    force_drift=0.005,
    torque_drift=5e-4,
    gain=0.01,
)
"""The sensor in the flange of a UR e-series.

Measured on a UR5e in force mode, 1 to 10 N (Trochimczuk et al., Sensors 26, 1709, 2026): the force deviates by 0.38 N
in the mean, which is 0.48 N as a normal distribution's deviation; at 10 N the mean ran from 8.95 to 13.26 N over the
workspace. The data sheet states less: an accuracy of 4.0 N and 0.3 N m (UR5e); users see 4 N without contact in force
mode (forum.universal-robots.com/t/39810). The smaller, measured figure counts here, torque in the data sheet's
proportion. Noise, drift and gain are those that this suite takes for an arm's sensor anywhere (docs/wrench.md).
"""

WRIST = ForceSensor(
    name="wrist sensor",
    rate=500.0,
    delay=0.004,
    force_noise=0.1,
    torque_noise=0.005,
    force_offset=0.05,
    torque_offset=0.002,
    force_drift=0.005,
    torque_drift=5e-4,
    gain=0.01,
)
"""A good strain-gauge sensor between flange and gripper.

Noise as the data sheet of a Robotiq FT 300-S has it (0.1 N, 0.005 N m), at five times its rate of 100 Hz
(manual, Sec. 4.4.2), which others of its price reach. Users measured 0.6 N over ten weighings with such a sensor
(forum.universal-robots.com/t/229); zeroed right before the task, a twelfth of that is left here.
"""

JOINT_TORQUES = ForceSensor(
    name="joint torques",
    rate=1000.0,
    delay=0.001,
    force_noise=0.035,
    torque_noise=0.005,
    force_offset=0.46,
    torque_offset=0.087,
    gain=0.01,
)
"""The load that an arm with joint torque sensors estimates.

Franka's data sheet: relative force accuracy 0.8 N and 0.15 N m, taken as bounds of what is drawn evenly; noise 0.035 N
and 0.005 N m rms.
"""


class ForceReader:
    """One sensor, drawn from a seed. `read` at each of its ticks gives the newest reading that is at hand."""

    def __init__(self, sensor: ForceSensor, seed: int) -> None:
        s, self._rng = sensor, np.random.default_rng([seed, 0xF7])
        self.sensor, self.period = sensor, 1.0 / sensor.rate
        normal, even = self._rng.standard_normal(6), self._rng.uniform(-1.0, 1.0, (2, 6))
        self._offset = _six(s.torque_offset, s.force_offset) * normal
        self._drift = _six(s.torque_drift, s.force_drift) * even[0]
        self._gain = 1.0 + s.gain * even[1]
        self._noise = _six(s.torque_noise, s.force_noise)
        self._on_their_way: deque[tuple[float, Array]] = deque()
        self._newest = np.zeros(6)

    def read(self, t: float, load: Array) -> Array:
        """The reading (6,) at hand at t [s], at which the true load is (6,) [N m, N]."""
        noise = self._noise * self._rng.standard_normal(6)
        self._on_their_way.append((t + self.sensor.delay, self._gain * load + self._offset + t * self._drift + noise))
        while self._on_their_way and self._on_their_way[0][0] <= t + 1e-9:
            self._newest = self._on_their_way.popleft()[1]
        return self._newest


def _six(torque: float, force: float) -> Array:
    """(6,) the same for all three axes of each."""
    return np.array((torque,) * 3 + (force,) * 3)
