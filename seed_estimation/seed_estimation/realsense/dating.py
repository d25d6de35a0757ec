# SPDX-License-Identifier: Apache-2.0
"""When an image was exposed, by this computer's clock.

A frame carries a time in one of three domains. `global_time`: the camera's clock, which the library fits to the
computer's; `hardware_clock`: the camera's own clock, which starts when it is powered; `system_time`: when the computer
got it. Frames in the second are dated by the one of the last seconds that came soonest: what every frame needs for
its way at least stays in their stamps, and an identification finds it (clocks.yaml).
"""

from collections import deque
from typing import Any

from seed_estimation.realsense import library

WINDOW = 300  # frames of which the soonest counts: 10 s, in which quartz clocks part by half a millisecond
MOST_AGE = 0.25  # [s] older, or in the future: the library has not fitted the camera's clock, or a clock was set
AHEAD = 0.002  # [s]
LONGEST = 0.1  # [s] from the middle of an exposure to its end


class Dating:
    """Dates the frames of one camera.

    Attributes:
        clock: what dated the last one, in words.
    """

    def __init__(self) -> None:
        self._offsets: deque[float] = deque(maxlen=WINDOW)  # [s] arrival minus the camera's time
        self._domain, self.clock = "", ""

    def date(self, told: float, domain: str, since_exposure: float, arrival: float) -> float:
        """Middle of the exposure [s].

        Args:
            told: the frame's time [s] in its domain.
            domain: global_time, hardware_clock or system_time.
            since_exposure: from the middle of the exposure to `told` [s].
            arrival: of the frame by this computer's clock [s].
        """
        if domain != self._domain or (self._offsets and abs(arrival - told - self._offsets[-1]) > MOST_AGE):
            self._offsets.clear()  # another clock, or one that was set
        self._domain = domain
        self._offsets.append(arrival - told)
        if domain != "hardware_clock" and -AHEAD <= arrival - told <= MOST_AGE:
            self.clock = domain
            return told - since_exposure
        self.clock = f"{domain}, dated by arrival"
        return told + min(self._offsets) - since_exposure


def since_exposure(frame: Any) -> float:
    """From the middle of a frame's exposure to the time that it carries [s], as far as the camera tells.

    librealsense2/h/rs_frame.h: FRAME_TIMESTAMP is when readout began, SENSOR_TIMESTAMP the middle of the exposure, both
    by the camera's clock; ACTUAL_EXPOSURE is its length; all in microseconds.
    """
    kind = library().frame_metadata_value

    def told(value: Any) -> float | None:
        return 1e-6 * frame.get_frame_metadata(value) if frame.supports_frame_metadata(value) else None

    readout, middle, length = told(kind.frame_timestamp), told(kind.sensor_timestamp), told(kind.actual_exposure)
    if readout is not None and middle is not None and 0.0 < readout - middle <= LONGEST:
        return readout - middle
    return 0.5 * length if length is not None and 0.0 < length <= 2.0 * LONGEST else 0.0
