# SPDX-License-Identifier: Apache-2.0
"""The speed slider of the pendant, moved while the arm follows targets: ./seed bench slider.

The targets go on at their own speed. A robot that is scaled down falls behind them; the command must not run ahead
of it, the arm must not make up for it faster than its limits once the slider is up, and must be back on its path then.
"""

from collections.abc import Callable
from math import cos, hypot, sin
from typing import Any, NamedTuple

import numpy as np

from seed_core.arm.quaternion import Quaternion, turned
from seed_core.vector3 import Vector3
from seed_testing.fault_bench.rig import play

ELBOW_UP = (0.0, -1.7, 2.1, -1.97, -1.57, 0.0)  # [rad]
RADIUS, TURNS = 0.05, 2.0  # [m], [rad/s] of a circle in y and z: 0.1 m/s
SWING, BEAT = 0.2, 1.5  # [rad], [rad/s] of a swing about x: 0.3 rad/s
DOWN, UP = 1.0, 3.0  # [s] when the slider leaves 100 %, and when it is back
SECONDS = 5.0  # [s] of a run
RECOVERED = 1.0  # [s] after the slider is back, in which the arm may catch up: the circle's far side at 0.25 m/s
MAX_SPEED, MAX_TURNING = 0.25, 1.0  # [m/s], [rad/s]

Slider = Callable[[float], float]  # 0..1, by time [s]


class Figures(NamedTuple):
    """What one run came to."""

    top_speed: float  # [m/s] of the flange
    top_turning: float  # [rad/s]
    path_error: float  # [m] from the path, the most from RECOVERED on
    behind: float  # [m] from the point of the path where it should be by then, less the lag at full speed
    holds: int


def _step(low: float) -> Slider:
    return lambda t: low if DOWN <= t < UP else 1.0


def _ramp(t: float) -> float:
    """From 100 % to 1 % in a second, and back in a second."""
    return min(1.0, max(0.01, abs(t - 0.5 * (DOWN + UP)) / (0.5 * (UP - DOWN))))


def _stairs(t: float) -> float:
    return (0.5, 0.1, 0.01, 0.0, 0.01, 0.1, 0.5, 0.01)[int((t - DOWN) / 0.25)] if DOWN <= t < UP else 1.0


def _fidgeting(t: float) -> float:
    """Up and down every 30 ms."""
    return 1.0 if not DOWN <= t < UP or int(t / 0.03) % 2 else 0.01


CASES: dict[str, Slider] = {
    "100 %": lambda _: 1.0,
    "50 %": _step(0.5),
    "10 %": _step(0.1),
    "1 %": _step(0.01),
    "0 %": _step(0.0),
    "ramp": _ramp,
    "stairs": _stairs,
    "fidgeting": _fidgeting,
    "1 % at the start": lambda t: 0.01 if t < UP else 1.0,
}


def circle(t: float, p: Vector3, q: Quaternion) -> tuple[Vector3, Quaternion]:
    """A target, starting at rest in p, q: the first half second gathers speed."""
    gathered = t - 0.25 if t > 0.5 else t * t
    a, b = TURNS * gathered, SWING * sin(BEAT * gathered)
    return (p[0], p[1] + RADIUS * sin(a), p[2] + RADIUS * (1.0 - cos(a))), turned(q, (b, 0.0, 0.0))


def measure(slider: Slider, **settings: Any) -> Figures:
    """One run with the slider moved as told."""
    robot, holds = play(ELBOW_UP, circle, SECONDS, slider=slider, **{"max_angular_speed": MAX_TURNING, **settings})
    track = np.array(robot.track)
    _, x, y, z = track[0, :4]
    after = track[track[:, 0] > UP + RECOVERED]
    off_x, off_r = after[:, 1] - x, np.hypot(after[:, 2] - y, after[:, 3] - z - RADIUS) - RADIUS
    behind = max(
        hypot(*np.subtract(circle(row[0] - 0.03, (x, y, z), (0.0, 0.0, 0.0, 1.0))[0], row[1:4])) for row in after[::10]
    )
    return Figures(robot.top_speed, robot.top_turning, float(np.hypot(off_x, off_r).max()), behind, len(holds))


def run() -> dict[str, Any]:
    """Figures of every case."""
    out = {}
    for name, slider in CASES.items():
        f = measure(slider)
        out[name] = {
            "top_speed_m_s": round(f.top_speed, 4),
            "top_turning_rad_s": round(f.top_turning, 4),
            "path_error_mm": round(1e3 * f.path_error, 3),
            "behind_mm": round(1e3 * f.behind, 2),
            "holds": f.holds,
        }
    return out
