# SPDX-License-Identifier: Apache-2.0
"""How the material at the edge of a patch turns about y, and that within: a tool that turns breaks loose at the edge.

Where a patch sticks, all of it turns with the tool. A turn takes the material further the further out it lies, and
pressure is least at the edge: there the tool slides first, and the middle holds longest. So the more of the patch
slides, the less its edge turns from image to image while its middle turns still.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from seed_core.spatial import Array
from seed_estimation.images.sampling import Crop
from seed_estimation.images.tactile_images import Array32
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.slip.following import flow_of, grey, rigid_step, thinned
from seed_estimation.slip.markers import Markers

WITHIN, EDGE_FROM = 0.6, 0.8  # [1] of the radius of a disc as wide as the patch: up to where, and from where on


class Twisting:
    """The patches of all fingers in one grasp."""

    def __init__(self, models: Sequence[FingerModel], reach: float) -> None:
        """reach: [m] at which a turn is a displacement."""
        self._models, self._reach = models, reach
        self._points = [_middle_and_edge(m.patch.points.p) for m in models]
        self._last: tuple[Mapping[str, Crop], list[Array]] | None = None  # images, X_CT of each finger's markers

    def step(self, crops: Mapping[str, Crop], markers: Sequence[Markers], turns: bool) -> Array | None:
        """Turn (2,) of the middle and of the edge since the last images [m], mean of all fingers.

        turns: whether the markers do; None: they do not, or too little of a patch is found.
        """
        last, self._last = self._last, (crops, [m.X_CT for m in markers])
        if last is None or not turns:
            return None
        found = []
        for model, pieces, X_CT in zip(self._models, self._points, last[1], strict=True):
            before, now = ((c, grey(c)) for c in (last[0][model.finger], crops[model.finger]))
            flows = [flow_of(model, points, X_CT, before, now) for points in pieces]
            found.append([math.nan if flow is None else rigid_step(*flow)[0] for flow in flows])
        step = self._reach * np.mean(found, axis=0)
        return np.asarray(step) if np.isfinite(step).all() else None


def _middle_and_edge(points: Array32) -> tuple[Array, Array]:
    """Some of the points (3, N) of a patch."""
    off = points[[0, 2]] - points[[0, 2]].mean(axis=1, keepdims=True)
    far = np.hypot(*off)
    radius = math.sqrt(2.0 * float(np.square(far).mean()))
    return thinned(points[:, far < WITHIN * radius]), thinned(points[:, far > EDGE_FROM * radius])
