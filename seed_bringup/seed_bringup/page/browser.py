# SPDX-License-Identifier: Apache-2.0
"""How a browser without a screen is started for tests and pictures of the page: it draws by software."""

import shutil

from seed_core.errors import FailedError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless",
    "--no-sandbox",  # as root, and in containers
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def browser() -> str:
    """The first that is installed. Raises FailedError: none is."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        raise FailedError(f"none of {', '.join(BROWSERS)} is here: apt-get install chromium")
    return found
