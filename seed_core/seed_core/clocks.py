# SPDX-License-Identifier: Apache-2.0
"""Whether images and robot are dated by one clock: the comparison's file, clocks.yaml, or the user's own word.

Estimator and controller get the same words, `clocks`: empty while nothing is known; the file of a comparison, whose
offset the estimator takes off the stamps; 'one' where one clock dates both (PTP, or one computer that knows the
cameras' delay); 'simulated' where simulated time does.
"""

import socket
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from seed_core.config import ConfigError, field, load_saved, save_file

ONE, SIMULATED = "one", "simulated"
CLOCKS_DOC = "whether images and robot are dated by one clock: '' unknown, a clocks.yaml, 'one' or 'simulated'"
UNKNOWN = (
    "the images' clock was never compared with the robot's: run ./seed identify --live and give "
    "clocks:=FOLDER/clocks.yaml to the launch, or clocks:=one where one clock dates both (PTP)"
)
LEAST = 0.002  # [s] of an offset that is worth taking off
_BOOT = Path("/proc/sys/kernel/random/boot_id")


@dataclass(frozen=True)
class ClockComparison:
    """A whole clocks.yaml."""

    offset: float = field(unit="s", low=-1.0, high=1.0, doc="by which images' stamps are ahead of the robot's")
    deviation: float = field(unit="s", low=0.0, high=0.05, doc="standard deviation of the offset")
    date: str = field(doc="when it was measured, ISO 8601 in quotes")
    host: str = field(doc="computer that it was measured on")
    boot: str = field("", doc="which start of that computer it was; a camera's own clock may start anew with it")
    robot: str = field("", doc="name of the robot")
    cameras: str = field("", doc="names of the cameras")
    version: int = field(1, low=1, high=1, doc="of this format")


class Clocks(NamedTuple):
    """What is known.

    Attributes:
        offset, deviation: by which images' stamps are ahead of the robot's, and its standard deviation [s].
        problem: why force must not be controlled; '' where it may.
        remark: what to tell of it.
    """

    offset: float = 0.0
    deviation: float = 0.0
    problem: str = ""
    remark: str = ""

    def not_taken_off(self, taken: float) -> str:
        """Why force must wait: the estimator takes another offset [s] off the stamps than the known one; or ''."""
        if abs(taken - self.offset) <= max(2.0 * self.deviation, LEAST):
            return ""
        return (
            f"the estimator takes {1e3 * taken:.1f} ms off the images' stamps, where the controller's clocks say "
            f"{1e3 * self.offset:.1f} ms: give the same clocks:= to the launch with the cameras and to that of the arm"
        )


def read_clocks(given: str) -> Clocks:
    """What the words say, on this computer.

    Raises:
        ConfigError: the file cannot be used.
    """
    if given in (ONE, SIMULATED):
        return Clocks(remark="one clock dates images and robot" if given == ONE else "simulated time")
    if not given:
        return Clocks(problem=UNKNOWN, remark="never compared")
    if not given.endswith((".yaml", ".yml")):
        raise ConfigError(f"clocks = '{given}' must be empty, '{ONE}', '{SIMULATED}' or name a .yaml file")
    known = load_saved(given, ClockComparison, "file of clocks")
    remark = f"offset {1e3 * known.offset:+.1f} +- {1e3 * known.deviation:.1f} ms of {known.date}"
    problem = ""
    if known.host != socket.gethostname():
        problem = f"{given} was measured on the computer '{known.host}', not on '{socket.gethostname()}': {UNKNOWN}"
    elif known.boot != boot():
        remark += ", measured before this computer was started: compare again if a camera dates images by its own clock"
    return Clocks(known.offset, known.deviation, problem, remark)


def boot() -> str:
    """Which start of this computer it is; '' where the system does not say."""
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return ""


def save_clocks(path: Path, offset: float, deviation: float, date: str, robot: str = "", cameras: str = "") -> None:
    """Write a comparison that was made on this computer, whole or not at all.

    Args:
        offset, deviation: by which images' stamps are ahead of the robot's, and its standard deviation [s].
        date: when, ISO 8601. robot, cameras: their names.
    """
    known = ClockComparison(offset, deviation, date, socket.gethostname(), boot(), robot, cameras)
    head = "# SPDX-License-Identifier: Apache-2.0\n# Clocks of images and robot: offset and deviation in s.\n"
    save_file(path, head, known)
