# SPDX-License-Identifier: Apache-2.0
"""The no-contact reference: what both bubbles look like while they touch nothing, and a grasp beside it.

It finds the contact patches of later images, corrects their depth, and tells whether a grasp was taken under load.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seed_core.spatial import Array, length
from seed_estimation.contact.grasp_zero import GraspZero, dragged, grasp_zero
from seed_estimation.contact.membrane import mean_depth, membrane_at_rest
from seed_estimation.contact.patch import QUICK, ContactPatch, PatchFinder
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.checks import EstimatorError
from seed_estimation.images.tactile_images import Image, Mask, TactileImages
from seed_estimation.parameters import EstimatorParameters

LEAST = 2  # images of a reference or a grasp: how they differ tells noise from the camera's fixed pattern
NO_LOAD = GraspZero(np.zeros(2), 0.0)


@dataclass(frozen=True, eq=False)
class Reference:
    """By finger, at the working resolution (h, w).

    Attributes:
        finders: of contact patches, in every pixel.
        quick: the same in every QUICK-th pixel and line, for the frame rate.
        correction: (h, w) [m] to add to depth: the calibrated range error, and the camera's fixed pattern.
        picture: (h, w) mean infrared [counts].
    """

    finders: dict[str, PatchFinder]
    quick: dict[str, PatchFinder]
    correction: dict[str, Image]
    picture: dict[str, Image]

    @classmethod
    def taken(
        cls,
        series: Mapping[str, Sequence[TactileImages]],
        cameras: Mapping[str, PinholeCamera],
        X_CX: Mapping[str, Array],
        offset: Mapping[str, Image],
        p: EstimatorParameters,
    ) -> "Reference":
        """The reference of some images of each finger, averaged.

        Args:
            series: images at the working resolution, their depth corrected by `offset`.
            cameras: of these images. X_CX: (4, 4) their poses in C.
            offset: (h, w) [m] of the calibrated range error.
            p: in force.

        Raises:
            EstimatorError: less than LEAST images, too little membrane in view, or no dome.
        """
        _refuse_few(series, "reference")
        membranes = {
            f: membrane_at_rest(f, cameras[f], X_CX[f], [i.depth for i in images], p) for f, images in series.items()
        }
        return cls(
            {f: PatchFinder(m) for f, m in membranes.items()},
            {f: PatchFinder(m, QUICK) for f, m in membranes.items()},
            {f: offset[f] + m.correction for f, m in membranes.items()},
            {f: np.mean([i.ir for i in images], axis=0, dtype=np.float32) for f, images in series.items()},
        )


@dataclass(frozen=True, eq=False)
class Grasp:
    """A tool that is held still: mean images of each finger, and where they touch.

    Attributes:
        depth: (h, w) [m]. ir: (h, w) [counts].
        masks: (h, w) of contact, 0 or 1. patches: of contact.
        zero: what the patches say about the load under which it was taken.
    """

    depth: dict[str, Image]
    ir: dict[str, Image]
    masks: dict[str, Mask]
    patches: dict[str, ContactPatch]
    zero: GraspZero

    @classmethod
    def taken(
        cls, series: Mapping[str, Sequence[TactileImages]], reference: Reference, p: EstimatorParameters
    ) -> "Grasp":
        """The grasp in some images of each finger, averaged; their depth is corrected.

        Raises:
            EstimatorError: less than LEAST images, a finger without contact, or too much load.
        """
        _refuse_few(series, "grasp")
        depth = {f: mean_depth([i.depth for i in images], p.near, p.far)[0] for f, images in series.items()}
        ir = {f: np.asarray(np.mean([i.ir for i in images], axis=0), np.float32) for f, images in series.items()}
        masks, patches = {}, {}
        for f, finder in reference.finders.items():
            masks[f], patches[f] = finder.find(depth[f], p)
            if not patches[f].in_contact:
                raise EstimatorError(
                    f"{f} bubble touches nothing: no {p.least_area} px are indented by {p.threshold * 1e3:g} mm; "
                    "close the gripper; if it is closed, the reference was taken with the tool in it: open, capture "
                    "the reference, close, and initialize the grasp again"
                )
        return cls(depth, ir, masks, patches, _load(reference, depth, ir, masks, p))


def _refuse_few(series: Mapping[str, Sequence[TactileImages]], purpose: str) -> None:
    """Raises EstimatorError: less than LEAST images of a finger."""
    for f, images in series.items():
        if len(images) < LEAST:
            raise EstimatorError(
                f"{purpose}: {len(images)} usable image of the {f} finger; at least {LEAST} are needed, for how they "
                "differ tells the camera's noise: hold still and take some more (15 are usual)"
            )


def _load(
    reference: Reference,
    depth: Mapping[str, Image],
    ir: Mapping[str, Image],
    masks: Mapping[str, Mask],
    p: EstimatorParameters,
) -> GraspZero:
    """What mean images and masks of a grasp say about its load. Raises EstimatorError: more than is allowed."""
    if p.loaded_grasp == "ignore":
        return NO_LOAD
    zero = grasp_zero(
        {
            f: dragged(s.membrane, reference.picture[f], depth[f], ir[f], s.core(depth[f], masks[f], p))
            for f, s in reference.finders.items()
        }
    )
    if (zero.loaded and p.loaded_grasp == "refuse") or (zero.words and length(zero.motion) > p.max_drag):
        raise EstimatorError(f"{zero.words}; let something carry its weight and grasp again")
    return zero
