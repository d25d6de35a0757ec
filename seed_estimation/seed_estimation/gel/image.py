# SPDX-License-Identifier: Apache-2.0
"""One colour image of a gel."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class GelImage:
    """What the camera behind one gel takes at one time.

    Attributes:
        rgb: (H, W, 3) uint8, red first.
        stamp: when it was taken [s].
    """

    rgb: NDArray[np.uint8]
    stamp: float
