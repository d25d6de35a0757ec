# SPDX-License-Identifier: Apache-2.0
"""A bag of a hand that was turned with a tool in it: poses of the arm, and of the tool in the grasp."""

from operator import attrgetter, itemgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seed_bringup.bags.files import read_messages
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array
from seed_ros.conversions import estimate_from_message, pose_to_matrix, seconds

_ARM, _POSES, _WIDTH, _PRESSURE = "/current_pose", "/relative_pose", "/gripper/width", "/pressure"
_RECORD = "./seed bag record current_pose relative_pose gripper/width bubble_left/pressure bubble_right/pressure"


class Recording(NamedTuple):
    """What a bag tells of a hand that was turned.

    Attributes:
        arm: stamp [s] and X_WE (4, 4) of the flange, in the order of time.
        estimates: of the tool in the grasp, in the order of time.
        width: mean of the gripper [m]. pressure: mean of both bubbles [hPa]. nan where none is recorded.
    """

    arm: list[tuple[float, Array]]
    estimates: list[RelativePoseEstimate]
    width: float
    pressure: float


def read_recording(path: Path) -> Recording:
    """Poses of arm and tool in a bag.

    Raises:
        SeedError: no bag; poses of arm or tool are missing in it, or there are those of several cells.
    """
    arm, estimates = list[tuple[float, Array]](), list[RelativePoseEstimate]()
    widths, pressures, topics = list[float](), list[float](), set[str]()

    def wanted(topic: str) -> bool:
        return topic.endswith((_ARM, _POSES, _WIDTH, _PRESSURE)) and "ground_truth" not in topic

    for topic, _, message in read_messages(path, wanted):
        topics.add(topic)
        if topic.endswith(_ARM):
            arm.append((seconds(message.header.stamp), pose_to_matrix(message.pose, topic)))
        elif topic.endswith(_POSES):
            estimates.append(estimate_from_message(message))
        else:
            (widths if topic.endswith(_WIDTH) else pressures).append(float(message.data))
    for name in (_ARM, _POSES):
        found = sorted(t for t in topics if t.endswith(name))
        if len(found) != 1:
            have = f"those of several cells: {', '.join(found)}" if found else f"no topic {name[1:]}"
            raise SeedError(f"{path} has {have}; record one cell: {_RECORD}")
    width, pressure = (float(np.mean(v)) if v else float("nan") for v in (widths, pressures))
    return Recording(sorted(arm, key=itemgetter(0)), sorted(estimates, key=attrgetter("stamp")), width, pressure)
