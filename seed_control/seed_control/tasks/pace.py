# SPDX-License-Identifier: Apache-2.0
"""How fast a path is gone: slower while the tip trails.

A tip that sticks while the gripper goes on leans the tool, until friction gives way. The gripper turns against that a
loop time later, so the lean is as large as the friction rises fast, that is, as the path goes fast. A path that waits
for the tool starts as fast as the tool can bear it, and goes at its full speed once the tip slides.
"""

from math import exp, inf, radians

from seed_control.state import ControllerState

# Lean up to which the path goes at full pace, and from which on at the least
_UPRIGHT, _LEANING = radians(2.0), radians(5.0)
_LEAST = 0.1  # never at rest: a lean that does not pass must not keep a task for ever
_AHEAD = 0.15  # [s] for which the lean is foretold: about from an image to the arm's answer
_SMOOTHING = 0.1  # [s]
_GAP = 0.3  # [s] between images, after which the lean is counted anew


class Pace:
    """Share of its speed at which a path is gone.

    Attributes:
        value: 0.1 to 1.
    """

    def __init__(self, rise: float) -> None:
        """rise: of the share per second, at most [1/s]; it falls at once."""
        self.value, self._rise, self._wanted = 1.0, rise, 1.0
        self._trailing = self._rate = 0.0  # [rad], [rad/s]
        self._stamp = -inf

    def update(self, dt: float, state: ControllerState) -> float:
        """The value after dt [s]."""
        if state.trailing is None or not state.in_contact:
            self._wanted, self._stamp = 1.0, -inf
        elif (stamp := state.stamp - state.image_age) > self._stamp + 1e-6:
            self._image(state.trailing, stamp - self._stamp)
            self._stamp = stamp
        self.value = min(self._wanted, self.value + self._rise * dt)
        return self.value

    def _image(self, trailing: float, frame: float) -> None:
        """Take in by how much [rad] the tip trails in an image, a frame [s] after the last: an alpha-beta filter."""
        if frame > _GAP:
            self._trailing, self._rate = trailing, 0.0
        else:
            left = exp(-frame / _SMOOTHING)
            foretold = self._trailing + frame * self._rate
            self._trailing = foretold + (1.0 - left**2) * (trailing - foretold)
            self._rate = self._rate + (1.0 - left) ** 2 / frame * (trailing - foretold)
        ahead = self._trailing + _AHEAD * self._rate
        self._wanted = min(max((_LEANING - ahead) / (_LEANING - _UPRIGHT), _LEAST), 1.0)
