# SPDX-License-Identifier: Apache-2.0
"""The lines of a file of samples from a bag: the node publishes each on `identification/samples` (std_msgs/String)."""

import json
from pathlib import Path
from typing import Any

from seed_sysid.data.dataset import FORMAT, DatasetError

TOPIC, TYPE = "identification/samples", "std_msgs/msg/String"


def bag_lines(path: Path) -> list[str]:
    """Header and samples recorded in a bag (folder, .mcap or .db3), the header first.

    Raises:
        DatasetError: no bag, none with that topic, or one with several identifications.
    """
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    folder = path.parent if not path.is_dir() and (path.parent / "metadata.yaml").is_file() else path
    types, messages = get_typestore(Stores.ROS2_JAZZY), list[Any]()
    try:
        with Reader(folder) as reader:
            connections = [c for c in reader.connections if c.topic.endswith(TOPIC) and c.msgtype == TYPE]
            if not connections:
                topics = ", ".join(sorted({c.topic for c in reader.connections})[:8])
                raise DatasetError(
                    f"{path} has no topic of {TYPE} ending in {TOPIC}; it has: {topics}: record that topic as well"
                )
            messages += [types.deserialize_cdr(raw, TYPE) for _, _, raw in reader.messages(connections)]
    except DatasetError:
        raise
    except Exception as error:  # rosbags raises whatever its decoders trip over in a damaged file
        raise DatasetError(f"{path} cannot be read as a bag: {error}") from error
    lines = list(dict.fromkeys(str(m.data) for m in messages))  # a run that goes on publishes what it has once more
    headers = [line for line in lines if f'"format": "{FORMAT}"' in line]
    runs = {_run(line) for line in headers}
    if len(runs) > 1:
        raise DatasetError(f"{path} holds {len(runs)} identifications: record each in a bag of its own")
    return headers[-1:] + [line for line in lines if line not in headers]  # the last has the sensor as corrected


def _run(header: str) -> tuple[str, str]:
    """Name and date of the run of a header; all of it where it is none that we wrote."""
    try:
        data = json.loads(header)
        return str(data["run"]), str(data["created"])
    except (ValueError, RecursionError, KeyError, TypeError):
        return header, ""
