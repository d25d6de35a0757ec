# SPDX-License-Identifier: Apache-2.0
"""A recorded press as a bag that the estimator node can be fed with.

    python -m seed_testing.recordings.press_bag PRESS.npz OUT.mcap [--finger left]

The recording itself stays where it is: only the bag, which nobody should commit, is written.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from seed_bringup.bags.files import BagWriter
from seed_core.command_line import command
from seed_testing.recordings.press import Press, load

START = 1_000_000_000  # [ns] time of the first frame where the recording starts at zero


def write(press: Press, path: Path, finger: str = "left", start: int = START, frames: int | None = None) -> None:
    """One bag with depth (32FC1, metres), grey (mono8, on depth's pixels) and camera_info of one finger.

    start: time of the first frame [ns]; frames: how many of the first to write, all when None.
    """
    space = f"/bubble_{finger}"
    with BagWriter(path) as bag:
        image, info = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
        topics = {
            "depth": bag.add_topic(f"{space}/depth/image_rect_raw", image),
            "ir": bag.add_topic(f"{space}/ir/image_rect_raw", image),
            "info": bag.add_topic(f"{space}/depth/camera_info", info),
        }
        store, first = bag.types.store, press.images[0].stamp
        for images in press.images[:frames]:
            stamp = start + round((images.stamp - first) * 1e9)
            depth, grey = images.depth.astype("<f4"), np.rint(images.ir).astype(np.uint8)
            for key, kind, message in (
                ("info", info, _info(store, press, stamp, finger)),
                ("depth", image, _image(store, depth, "32FC1", stamp, finger)),
                ("ir", image, _image(store, grey, "mono8", stamp, finger)),
            ):
                bag.write(topics[key], stamp, bytes(store.serialize_cdr(message, kind)))


def _header(store, stamp: int, finger: str):  # type: ignore[no-untyped-def]
    types = store.types
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    return types["std_msgs/msg/Header"](stamp=time, frame_id=f"bubble_{finger}_optical_frame")


def _image(store, pixels: np.ndarray, encoding: str, stamp: int, finger: str):  # type: ignore[no-untyped-def]
    h, w = pixels.shape
    return store.types["sensor_msgs/msg/Image"](
        header=_header(store, stamp, finger), height=h, width=w, encoding=encoding, is_bigendian=0,
        step=w * pixels.itemsize, data=np.frombuffer(pixels.tobytes(), np.uint8),
    )  # fmt: skip


def _info(store, press: Press, stamp: int, finger: str):  # type: ignore[no-untyped-def]
    camera = press.camera
    roi = store.types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    P = np.zeros((3, 4))
    P[:, :3] = camera.K
    return store.types["sensor_msgs/msg/CameraInfo"](
        header=_header(store, stamp, finger), height=camera.height, width=camera.width, distortion_model=camera.model,
        d=camera.D.copy(), k=camera.K.ravel().copy(), r=np.eye(3).ravel(), p=P.ravel(), binning_x=0,
        binning_y=0, roi=roi,
    )  # fmt: skip


@command("seed_testing.recordings.press_bag")
def main(argv: list[str]) -> int:
    """Write the bag."""
    parser = argparse.ArgumentParser(description="Turn a recorded press into a bag.")
    parser.add_argument("press", type=Path)
    parser.add_argument("bag", type=Path, help="must not exist; .mcap for a single file")
    parser.add_argument("--finger", choices=("left", "right"), default="left")
    options = parser.parse_args(argv)
    write(load(options.press), options.bag, options.finger)
    print(f"written to {options.bag}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
