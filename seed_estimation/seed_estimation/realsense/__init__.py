# SPDX-License-Identifier: Apache-2.0
"""RealSense D405 cameras in the bubbles: found, opened, dated, looked after. pyrealsense2 is loaded when used."""

from typing import Any

from seed_core.errors import SeedError


class RealSenseError(SeedError):
    """A camera that cannot be used, with what to do about it."""


def library() -> Any:
    """The module pyrealsense2.

    Raises:
        RealSenseError: it, or what it stands on, is not installed.
    """
    try:
        import pyrealsense2
    except ImportError as error:
        what = (
            "install it with: sudo apt-get install libusb-1.0-0"
            if "libusb" in str(error)
            else "install it with: pip install pyrealsense2"
        )
        raise RealSenseError(f"RealSense cameras need pyrealsense2, which cannot be loaded: {error}; {what}") from error
    return pyrealsense2
