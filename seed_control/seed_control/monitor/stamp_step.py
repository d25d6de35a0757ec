# SPDX-License-Identifier: Apache-2.0
"""Whether the clock that dates images was set back, told by stamps that fall while images go on coming.

Images may come late, but not before one another: several in a row, in order among themselves and dated before one that
came earlier, are dated by a clock that was set back. By how much, the time from stamp to arrival shows; it has to be
what it was before until images count as dated right again.
"""

from math import inf, isfinite

_IMAGES = 3  # in a row that are dated before one that came earlier
_RIGHT = 25  # images in a row that came as soon after their stamps as before
_SLOWLY = 0.1  # of an image's delay that goes into the usual one


class StampStep:
    """`update` with each image as it comes.

    Attributes:
        reason: why force must not be controlled; '' while nothing is wrong.
    """

    def __init__(self, most: float) -> None:
        """most: [s] by which stamps may be wrong."""
        self._most = most
        self.restart()

    def restart(self) -> None:
        """Time begins anew."""
        self._newest = self._last = -inf  # stamps [s]
        self._delay: float | None = None  # [s] from stamp to arrival, as usual
        self._back = self._right = 0  # images in a row
        self.reason = ""

    def update(self, stamp: float, now: float) -> None:
        """Take in the stamp of an image that arrives now, both [s]."""
        if not (isfinite(stamp) and isfinite(now)):
            return
        follows, self._last = stamp > self._last, stamp
        delay = now - stamp
        if self._delay is None:
            self._delay = delay
        late = delay - self._delay
        if stamp <= self._newest:
            self._back = self._back + 1 if late > self._most and (follows or not self._back) else 0
            if self._back >= _IMAGES:
                self._right = 0
                self.reason = (
                    f"images are dated {1e3 * late:.0f} ms earlier than before, at most {1e3 * self._most:.0f} ms: the "
                    "clock of the cameras was set back; set it right, or compare the clocks (./seed identify --live)"
                )
            return
        self._newest, self._back = stamp, 0
        if not self.reason:
            self._delay += _SLOWLY * late
            return
        self._right = self._right + 1 if late <= self._most else 0
        if self._right >= _RIGHT:
            self.reason = ""
