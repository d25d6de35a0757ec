# SPDX-License-Identifier: Apache-2.0
"""A page without a browser, for tests and long runs: it connects as one does, reads the words, presses the buttons."""

import html
import re
import threading
from typing import Any

import viser
import websockets
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

CAMERA = {  # where it says that it looks from: a page counts as open from then on
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, -1.0, 1.0),
    "fov": 0.8,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 500,
    "image_width": 800,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
HEAD = 16  # [byte] before the packed messages of a window: two lengths
TAG = re.compile(r"<style>.*?</style>|<[^>]*>", re.DOTALL)


class Visitor:
    """A context manager.

    Attributes:
        pictures: tactile pictures that have come.
    """

    def __init__(self, address: str) -> None:
        """address: of the page, as it is printed."""
        protocol = websockets.Subprotocol(f"viser-v{viser.__version__}")
        self._socket = connect(address.replace("http", "ws", 1), subprotocols=[protocol], max_size=None)
        self._elements: dict[str, dict[str, Any]] = {}
        self.pictures = 0
        self._send(CAMERA)
        self._thread = threading.Thread(target=self._listen, name="visitor", daemon=True)
        self._thread.start()

    def __enter__(self) -> "Visitor":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the page."""
        self._socket.close()
        self._thread.join(timeout=5.0)

    @property
    def words(self) -> str:
        """All that stands on the page but the buttons, element by element in lines."""
        told = (e["content"] for e in list(self._elements.values()) if isinstance(e.get("content"), str))
        return "\n".join(" ".join(html.unescape(TAG.sub(" ", text)).split()) for text in told)

    def press(self, button: str) -> None:
        """Raises KeyError: there is no such button."""
        found = {e.get("label"): uuid for uuid, e in list(self._elements.items())}
        self._send({"type": "GuiUpdateMessage", "uuid": found[button], "updates": {"value": True}})

    def _send(self, message: dict[str, Any]) -> None:
        import msgspec.msgpack  # this and zstandard come with viser

        self._socket.send(msgspec.msgpack.encode(message))

    def _listen(self) -> None:
        import msgspec.msgpack
        import zstandard

        unpack = zstandard.ZstdDecompressor()
        try:
            for window in self._socket:
                assert isinstance(window, bytes)
                length = int.from_bytes(window[8:HEAD], "little")
                told = msgspec.msgpack.decode(unpack.decompress(window[HEAD : HEAD + length]))
                for message in told["messages"]:
                    self._hear(message)
        except ConnectionClosed:
            return

    def _hear(self, message: dict[str, Any]) -> None:
        if "uuid" not in message:
            return
        element = self._elements.setdefault(message["uuid"], {})
        news = message.get("updates") or message.get("props") or {}
        self.pictures += "_data" in news
        element.update({name: value for name, value in news.items() if name in ("content", "label")})
