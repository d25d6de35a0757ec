# SPDX-License-Identifier: Apache-2.0
"""From episodes as plain arrays to a LeRobot dataset. Runs in LeRobot's own environment, where nothing of ours is.

python lerobot_writer.py ARRAYS OUT REPO_ID
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np


def features(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields as the library wants them described."""
    out = {}
    for name, field in fields.items():
        image = name.startswith("observation.images.")
        names = ["height", "width", "channels"] if image else field["names"]
        out[name] = {"dtype": "image" if image else "float32", "shape": tuple(field["shape"]), "names": names}
    return out


def main(arrays: Path, out: Path, repo_id: str) -> None:
    """Write all episodes."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # the suite's own environment has none

    info = json.loads((arrays / "info.json").read_text())
    fields = features(info["fields"])
    dataset = LeRobotDataset.create(
        repo_id, fps=info["fps"], features=fields, root=out, robot_type="seed", use_videos=False
    )
    for i, episode in enumerate(info["episodes"]):
        with np.load(arrays / f"episode_{i:03d}.npz") as data:
            columns = {name: data[name] for name in fields}
        for k in range(episode["frames"]):
            dataset.add_frame({**{name: values[k] for name, values in columns.items()}, "task": episode["task"]})
        dataset.save_episode()
    dataset.finalize()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
