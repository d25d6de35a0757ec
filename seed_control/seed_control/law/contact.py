# SPDX-License-Identifier: Apache-2.0
"""Where the tool touches, direction by direction: some images in a row above a share of the wanted force.

Contact along a direction is lost when the mean of some more images is below another share, as far as noise lets tell.
"""

from collections import deque
from typing import NamedTuple

from seed_control.parameters import ControllerParameters
from seed_core.spatial import Array

_CERTAIN = 2.5  # deviations of the estimated force (of its mean, for a loss) that count
_MOST_LOST = 0.5  # share of the wanted force, at most, below which contact is lost however much noise there is


class _Direction:
    """One force direction that is to press."""

    def __init__(self, parameters: ControllerParameters) -> None:
        self._parameters = parameters
        self.made = False
        self._above = 0  # images in a row
        self._recent: deque[float] = deque(maxlen=parameters.lost_images)  # [N] since contact

    def update(self, force: float, wanted: float, deviation: float) -> None:
        """Take in an image's force, counted along the wanted one [N]."""
        p = self._parameters
        self._recent.append(force)
        if not self.made:
            touches = force > max(p.contact_share * wanted, _CERTAIN * deviation)
            self._above = self._above + 1 if touches else 0
            if self._above >= p.contact_images:
                self.made = True
                self._recent.clear()
            return
        n = len(self._recent)
        least = min(p.lost_share * wanted + _CERTAIN * deviation / n**0.5, max(_MOST_LOST, p.lost_share) * wanted)
        if n == p.lost_images and sum(self._recent) < n * least:
            self.made, self._above = False, 0


class ContactDetector:
    """Contact by force direction.

    Attributes:
        touching: (m,) whether the tool touches along each; one that is to carry no force touches with the others, and
            all as before where none is.
        lost: how often contact was lost. once: whether there has been contact since it was to be found anew.
        rests: [m] heights of the undeflected tip that has let go and stays there, by force direction.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        self._parameters = parameters
        self._directions: list[_Direction] = []
        self.touching: tuple[bool, ...] = ()
        self.lost, self.once = 0, False
        self.rests: dict[int, float] = {}

    @property
    def made(self) -> bool:
        """Whether the tool touches wherever it is to press."""
        return bool(self.touching) and all(self.touching)

    @property
    def anywhere(self) -> bool:
        """Whether the tool touches along any direction."""
        return any(self.touching)

    def reset(self) -> None:
        """Contact is to be found anew."""
        self._directions, self.touching, self.once = [], (), False
        self.rests.clear()

    def update(self, along: Array, wanted: Array, deviation: float, known: bool = False) -> tuple[int, ...]:
        """Take in one image; the directions along which it has made contact.

        Args:
            along, wanted: estimated and wanted force (m,) [N] along the force directions.
            deviation: standard deviation of the estimate [N].
            known: it touches, however little it presses.
        """
        if known:
            before = self.touching if len(self.touching) == len(along) else (False,) * len(along)
            self._directions, self.touching, self.once = [], (True,) * len(along), True
            return tuple(i for i, was in enumerate(before) if not was)
        if len(self._directions) != len(along):
            self._directions = [_Direction(self._parameters) for _ in along]
            self.touching = (False,) * len(along)
        before, pressing = self.touching, [w != 0.0 for w in wanted.tolist()]
        for i, (f, w) in enumerate(zip(along.tolist(), wanted.tolist(), strict=True)):
            if w:
                self._directions[i].update(f if w > 0.0 else -f, abs(w), deviation)
        made = self.made  # stays while no force is wanted at all: what touched is then let go of, not pressed further
        if any(pressing):
            made = all(d.made for d, on in zip(self._directions, pressing, strict=True) if on)
        self.touching = tuple(d.made if on else made for d, on in zip(self._directions, pressing, strict=True))
        self.once |= self.made
        changed = list(zip(before, self.touching, pressing, strict=True))
        self.lost += any(was and not now and on for was, now, on in changed)
        return tuple(i for i, (was, now, _) in enumerate(changed) if now and not was)


class ForceShare(NamedTuple):
    """How much of the wanted force there is along one force direction.

    Attributes:
        share: of the wanted force.
        reached: as `reached` has it.
        needed: deflection [m] that the wanted force needs.
        across: force across the direction, as a share of the wanted one.
        touches: whether the tool touches along it.
    """

    share: float
    reached: bool
    needed: float
    across: float
    touches: bool = True


def reached(force: float, wanted: float) -> bool:
    """Whether a force [N] is within a tenth of the wanted one, at least 0.3 N."""
    return abs(force - wanted) < max(0.1 * abs(wanted), 0.3)
