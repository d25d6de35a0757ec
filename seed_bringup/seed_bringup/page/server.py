# SPDX-License-Identifier: Apache-2.0
"""The web server of the page: on loopback, for pages of its own only, and without a way out.

Viser would offer to send the page through a server of its makers; that is switched off. A page of another site that
is open in the same browser could reach a server on loopback and press its buttons: connections that such a page opens
are refused. The page itself is viser's, with a script for browsers that draw in software.
"""

import contextlib
import functools
import io
import re
from collections.abc import Iterator
from typing import Any

import viser
import websockets.asyncio.server

from seed_bringup.page.slow_browser import with_script

LOOPBACK, PORT = "127.0.0.1", 8080
OWN_PAGES = re.compile(r"http://(127\.0\.0\.1|localhost)(:\d+)?")


class PageServer(viser.ViserServer):
    """A viser server for this computer alone; if the port is taken, the next that is free."""

    def __init__(self, port: int = PORT, title: str = "SEED") -> None:
        with _own_pages(), contextlib.redirect_stdout(io.StringIO()):  # it would print a banner
            super().__init__(host=LOOPBACK, port=port, label=title, verbose=False)
        self.gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=(38, 110, 164), control_width="large"
        )

    def stop(self) -> None:
        """End, without a word of viser's own."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()

    def request_share_url(self, verbose: bool = True) -> None:
        """Nothing leaves this computer."""

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://{LOOPBACK}:{self.get_port()}"


@contextlib.contextmanager
def _own_pages() -> Iterator[None]:
    """Servers that are started meanwhile refuse connections from pages of other sites; programs have no origin."""
    serve = websockets.asyncio.server.serve

    @functools.wraps(serve)
    def serve_own(*arguments: Any, **settings: Any) -> Any:
        settings["process_request"] = with_script(settings["process_request"])
        return serve(*arguments, **settings, origins=[OWN_PAGES, None])

    websockets.asyncio.server.serve = serve_own  # type: ignore[misc,assignment]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
