# SPDX-License-Identifier: Apache-2.0
"""Whether the tool touches: some images in a row above a share of each wanted force; lost after more below another."""

from seed_control.parameters import ControllerParameters
from seed_core.spatial import Array

_CERTAIN = 2.5  # deviations of the estimated force that contact must stand out by


class ContactDetector:
    """`made`: in contact now; `lost`: how often contact was lost."""

    def __init__(self, parameters: ControllerParameters) -> None:
        self._parameters = parameters
        self._above = self._below = 0  # images in a row
        self.made = False
        self.lost = 0

    def reset(self) -> None:
        """Contact is to be found anew."""
        self.made, self._above, self._below = False, 0, 0

    def update(self, along: Array, wanted: Array, deviation: float) -> bool:
        """Take in one image; whether contact was made by this very one.

        Args:
            along, wanted: estimated and wanted force (m,) [N] along the force directions.
            deviation: standard deviation of the estimate [N].
        """
        pairs = [(f if w > 0.0 else -f, abs(w)) for f, w in zip(along.tolist(), wanted.tolist(), strict=True) if w]
        if not pairs:
            return False
        p, least = self._parameters, _CERTAIN * deviation
        above = any(f > max(p.contact_share * size, least) for f, size in pairs)
        below = all(f < p.lost_share * size for f, size in pairs)
        self._above, self._below = self._above + 1 if above else 0, self._below + 1 if below else 0
        if not self.made and self._above >= p.contact_images:
            self.made = True
            return True
        if self.made and self._below >= p.lost_images:
            self.made = False
            self.lost += 1
        return False
