# SPDX-License-Identifier: Apache-2.0
"""How far the arm is from itself, floor, planes and boxes, its base's axis and the ends of its joints.

One number per thing, its row: a distance less the least one, so below 0 is too near.
"""

from collections.abc import Sequence
from math import degrees

import numpy as np

from seed_core.spatial import Array, rotation_from_rpy
from seed_driver.clearance_settings import ClearanceSettings
from seed_driver.motion.surroundings import Box, Plane, carried, floor_and_planes, read_surroundings
from seed_ur.capsules import JOINED, Capsule, Skeleton, arm_capsules
from seed_ur.distances import between_segments, from_boxes, from_planes
from seed_ur.kinematics import URKinematics
from seed_ur.models import JOINT_NAMES

EXACT = 0.05  # [m] beyond which the distance from a box is not computed exactly but from below
INSIDE = 1e-6  # [m] from the axis of a body to a box: it is inside


class Clearances:
    """The rows of an arm, by joint angles.

    Attributes:
        rates: (rows, 6) [m/rad] by which a row changes at most per turn of each joint; angles change as they do.
        inside: (rows,) at or below which the axis of a body is in a box, and no distance tells the way out.
    """

    def __init__(self, arm: URKinematics, settings: ClearanceSettings) -> None:
        """Raises SeedError where a file is missing or wrong."""
        self._arm = arm
        self._surroundings = read_surroundings(settings)
        on_flange = carried(settings, self._surroundings)
        self._touching = len(on_flange.touching)
        self._skeleton = Skeleton((*arm_capsules(arm.model.name), *on_flange.hard, *on_flange.touching))
        lengths = [abs(a) + abs(d) for a, d in zip(arm.model.a, arm.model.d, strict=True)]
        widest = max(c.radius + max(map(_length, (c.start, c.end))) for c in self._skeleton.capsules)
        self._reach = np.array([sum(lengths[i:]) for i in range(6)]) + widest
        self.configure(settings)

    def configure(self, settings: ClearanceSettings) -> None:
        """Take changed settings; their files are those of the beginning."""
        self._settings = s = settings
        self._lay_out_pairs(s.self_check, s.clearance)
        self._lay_out_planes(floor_and_planes(s, self._surroundings), s.clearance)
        self._lay_out_boxes(self._surroundings.boxes, s.clearance)
        self._low, self._high = np.array(s.joint_low), np.array(s.joint_high)
        distances = len(self._names)
        joints = np.arange(6)
        moved = [(joints >= a) & (joints < min(b, 6)) for a, b in self._frames]  # by these joints, against each other
        axis = np.full((1, 6), self._reach)
        self.rates = np.concatenate((np.array(moved).reshape(-1, 6) * self._reach, axis, np.eye(6), np.eye(6)))
        self.inside = np.full(distances + 13, -np.inf)
        boxes = len(self._box_reach)
        self.inside[distances - boxes : distances] = INSIDE - self._box_reach

    def _lay_out_pairs(self, wanted: bool, clearance: float) -> None:
        capsules, radii = self._skeleton.capsules, self._skeleton.radii
        n = range(len(capsules)) if wanted else range(0)
        ordered = [(i, j) for i in n for j in n if capsules[i].frame < capsules[j].frame]
        pairs = [(i, j) for i, j in ordered if (capsules[i].frame, capsules[j].frame) not in JOINED]
        self._pairs = np.array(pairs, dtype=int).reshape(-1, 2).T
        self._pair_reach = radii[self._pairs[0]] + radii[self._pairs[1]] + clearance
        self._names = [(capsules[i].body, capsules[j].body) for i, j in pairs]
        self._frames = [(capsules[i].frame, capsules[j].frame) for i, j in pairs]

    def _apart(self, things: Sequence[Box | Plane]) -> list[tuple[int, int]]:
        """Which capsule is kept from which thing: all that move, or all but those that may touch it."""
        capsules = self._skeleton.capsules
        hard = len(capsules) - self._touching
        return [
            (i, k)
            for k, thing in enumerate(things)
            for i, capsule in enumerate(capsules)
            if capsule.frame > 0 and (i < hard or not thing.tool_may_touch)
        ]

    def _lay_out_planes(self, planes: Sequence[Plane], clearance: float) -> None:
        rows = np.array(self._apart(planes), dtype=int).reshape(-1, 2).T
        self._by_plane = rows[0]
        self._normals = np.array([planes[k].unit_normal for k in rows[1]]).reshape(-1, 3)
        self._offsets = np.array([planes[k].offset for k in rows[1]]) + self._skeleton.radii[rows[0]] + clearance
        self._add_rows([(self._skeleton.capsules[i], planes[k].name) for i, k in rows.T])

    def _lay_out_boxes(self, boxes: Sequence[Box], clearance: float) -> None:
        rows = np.array(self._apart(boxes), dtype=int).reshape(-1, 2).T
        self._by_box = rows[0]
        self._rotations = np.array([rotation_from_rpy(np.deg2rad(boxes[k].rpy_deg)) for k in rows[1]]).reshape(-1, 3, 3)
        self._centres = np.array([boxes[k].position for k in rows[1]]).reshape(-1, 3)
        self._halves = 0.5 * np.array([boxes[k].size for k in rows[1]]).reshape(-1, 3)
        self._box_reach = self._skeleton.radii[rows[0]] + clearance
        self._add_rows([(self._skeleton.capsules[i], boxes[k].name) for i, k in rows.T])

    def _add_rows(self, rows: Sequence[tuple[Capsule, str]]) -> None:
        """Rows of capsules and things that stand in the base's frame."""
        self._names += [(capsule.body, name) for capsule, name in rows]
        self._frames += [(0, capsule.frame) for capsule, _ in rows]

    def values(self, joints: Sequence[Sequence[float]]) -> Array:
        """The rows (m, rows) for m times six joint angles [rad]."""
        q = np.array(joints)
        frames = np.empty((len(q), 8, 4, 4))
        frames[:, 0] = np.eye(4)
        for k, angles in enumerate(joints):
            frames[k, 1:7] = self._arm.frames(angles)
        frames[:, 7] = frames[:, 6]
        start, end = self._skeleton.segments(frames)
        i, j = self._pairs
        a, b, c, d = (np.take(points, k, axis=1) for points, k in ((start, i), (end, i), (start, j), (end, j)))
        flange = frames[:, 6, :2, 3]
        return np.concatenate(
            (
                between_segments(a, b, c, d) - self._pair_reach,
                from_planes(start[:, self._by_plane], end[:, self._by_plane], self._normals, self._offsets),
                self._to_boxes(start[:, self._by_box], end[:, self._by_box]) - self._box_reach,
                np.hypot(flange[:, :1], flange[:, 1:]) - self._settings.min_radius,
                q - self._low,
                self._high - q,
            ),
            axis=1,
        )

    def _to_boxes(self, start: Array, end: Array) -> Array:
        """Distances (m, n) [m] from boxes: exact where near, elsewhere that of the middle less half the length."""
        if not start.shape[1]:
            return np.zeros(start.shape[:2])
        middle, half = 0.5 * (start + end) - self._centres, 0.5 * np.linalg.norm(end - start, axis=-1)
        gap = np.maximum(np.abs(np.einsum("mni,nij->mnj", middle, self._rotations)) - self._halves, 0.0)
        distances = np.asarray(np.linalg.norm(gap, axis=-1) - half)
        near = np.flatnonzero((distances - self._box_reach).min(axis=0) < EXACT)
        if len(near):
            box = self._rotations[near], self._centres[near], self._halves[near]
            distances[:, near] = from_boxes(start[:, near], end[:, near], *box)
        return distances

    def words(self, row: int, value: float) -> str:
        """What a row means at a value that is too low."""
        s, names = self._settings, self._names
        if row < len(names):
            distance = 1e3 * (value + s.clearance)
            a, b = names[row]
            how = f"within {distance:.0f} mm of" if distance >= 0.0 else f"{-distance:.0f} mm into"
            return f"the {a} would come {how} the {b}, at least {1e3 * s.clearance:.0f} mm (clearance)"
        if row == len(names):
            at_least = f"at least {s.min_radius:g} m (min_radius)"
            return f"the flange would come within {value + s.min_radius:.3f} m of the base's axis, {at_least}"
        i, high = (row - len(names) - 1) % 6, row - len(names) > 6
        bound, name = (s.joint_high[i], "joint_high") if high else (s.joint_low[i], "joint_low")
        angle = degrees(bound - value if high else bound + value)
        beyond = f"{name} = {bound:.4g} rad ({degrees(bound):.1f} degrees)"
        return f"{JOINT_NAMES[i]} would turn to {angle:.1f} degrees, beyond {beyond}"


def _length(v: Sequence[float]) -> float:
    return float(np.linalg.norm(v))
