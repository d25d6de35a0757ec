# SPDX-License-Identifier: Apache-2.0
"""./seed bench page: what the operator page costs a cell that works, closed and open in a browser, in turn."""

import json
import os
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from seed_bringup.launching.domains import OWN, claimed
from seed_bringup.page.browser import FLAGS, browser
from seed_core.errors import FailedError
from seed_core.program.command_line import Parser, command, number, whole
from seed_testing.figures import text
from seed_testing.live.processes import cpu_time, descendants, usage

TASK = "squeegee"
SETTLES = 3.0  # [s] after a browser is started, or a page opened or closed, before anything is counted
SMALL = {"width": 800, "height": 500}  # [px]: the browser draws by software, on the cores of the cell
PATIENCE = 180.0  # [s] for the first picture
# Counts the tactile pictures, which are drawn anew with everything else, and notes when bubbles and tool came into the
# 3-D view [ms since the page was asked for]: they have colours; arm, floor and table are grey.
LOOK = """
window.pictures = window.seen = 0;
new MutationObserver((changes) => { window.pictures += changes.filter((c) => c.target.tagName === 'IMG').length; })
  .observe(document, {subtree: true, attributes: true, attributeFilter: ['src']});
const plain = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, settings) {
  return plain.call(this, kind, kind.startsWith('webgl') ? {...settings, preserveDrawingBuffer: true} : settings);
};
const small = Object.assign(document.createElement('canvas'), {width: 96, height: 64});
const look = () => {
  const view = document.querySelector('canvas[data-engine^=three]');
  let coloured = 0;
  if (view && view.width) {
    const pen = small.getContext('2d', {willReadFrequently: true});
    pen.drawImage(view, 0, 0, 96, 64);
    const rgba = pen.getImageData(0, 0, 96, 64).data;
    for (let i = 0; i < rgba.length; i += 4) {
      const [r, g, b] = [rgba[i], rgba[i + 1], rgba[i + 2]];
      coloured += Math.max(r, g, b) - Math.min(r, g, b) > 60;
    }
  }
  if (coloured > 12) window.seen = performance.now(); else setTimeout(look, 100);
};
look();
"""


@command("seed bench page")
def main(argv: list[str]) -> int:
    """Print the figures of both."""
    p = Parser(prog="seed bench page", description=__doc__)
    p.add_argument("--rounds", type=whole(1), default=4, help="each: closed for a while, then open for as long")
    p.add_argument("--seconds", type=number(2.0, "s"), default=20.0, help="[s] that each is looked at")
    p.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    p.add_argument("cell", nargs="*", default=[], metavar="NAME:=VALUE", help="launch arguments, as of seed demo")
    o = p.parse_args(argv)
    program = browser()
    with claimed(OWN, "seed bench page"), tempfile.TemporaryDirectory(prefix="seed-page-") as folder:
        figures = run(dict(word.split(":=", 1) for word in o.cell), program, o.rounds, o.seconds, Path(folder))
    print(json.dumps(figures) if o.json else "\n".join(text(figures)))
    return 0


def run(arguments: dict[str, str], program: str, rounds: int, seconds: float, folder: Path) -> dict[str, Any]:
    """Play a task again and again, with the page closed and open in turn."""
    from seed_bringup.ros.session import SessionError
    from seed_testing.live.ros.cell import Cell

    with Cell({"view_port": "0", **arguments}, log=folder / "nodes.log") as cell:
        cell.prepare()
        if not cell.page:
            raise FailedError("the cell has no page: leave out view:=false")
        pages = _Pages(program, cell.page, cell.pids(), rounds, seconds)
        cell.also = lambda: pages.hear(cell.factors)
        pages.start()
        errors, ended = [], 0
        while pages.is_alive():
            try:
                cell.enable()
                result = cell.play(TASK, patience=600.0).result
                errors.append(result.force_rmse) if result.success else None
                ended += not result.success
            except SessionError:
                ended += 1
                cell.recover()
        pages.join()
    if pages.error is not None:
        raise pages.error
    told = {"tasks": len(errors), "tasks_ended_early": ended, "force_rmse_N": float(np.median(errors or [np.nan]))}
    return told | {kind: _summary([w for k, w in pages.windows if k == kind]) for kind in ("closed", "open")}


def _summary(windows: list[dict[str, float]]) -> dict[str, float]:
    """Median over the windows, and the worst first picture."""
    names = windows[0].keys() if windows else ()
    found = {name: float(np.median([w[name] for w in windows])) for name in names}
    if "first_picture_s" in found:
        found["first_picture_worst_s"] = max(w["first_picture_s"] for w in windows)
    return found


class _Pages(threading.Thread):
    """Closed, open, closed, open: a thread of its own, for the cell's task wants to be seen to meanwhile."""

    def __init__(self, program: str, address: str, nodes: dict[str, int], rounds: int, seconds: float) -> None:
        super().__init__(daemon=True)
        self._program, self._address, self._nodes = program, address, nodes
        self._rounds, self._seconds = rounds, seconds
        self._factors: list[float] = []
        self.windows: list[tuple[str, dict[str, float]]] = []
        self.error: Exception | None = None

    def hear(self, factors: list[float]) -> None:
        """The cell's real-time factors so far."""
        self._factors = factors

    def run(self) -> None:
        """All rounds."""
        from playwright.sync_api import sync_playwright

        try:
            with sync_playwright() as p:
                for _ in range(self._rounds):
                    time.sleep(SETTLES)
                    self.windows.append(("closed", self._window(None)))
                    self._open(p)
        except Exception as error:
            self.error = error

    def _open(self, playwright: Any) -> None:
        """A window with the page in a browser."""
        chromium = playwright.chromium.launch(executable_path=self._program, args=list(FLAGS))
        page = chromium.new_page(viewport=SMALL)
        page.add_init_script(LOOK)
        time.sleep(SETTLES)  # whoever opens the page has a browser that runs
        page.goto(self._address, timeout=1e3 * PATIENCE)
        page.wait_for_function("window.seen > 0", timeout=1e3 * PATIENCE, polling=200.0)
        first = 1e-3 * float(page.evaluate("window.seen"))
        time.sleep(SETTLES)
        self.windows.append(("open", self._window(page) | {"first_picture_s": first}))
        chromium.close()

    def _window(self, shown: Any) -> dict[str, float]:
        """shown: the page in the browser; None: closed."""
        page = self._nodes["page"]
        browser = descendants(os.getpid()) - set(self._nodes.values())
        drawn = _pictures(shown)
        factors, began = len(self._factors), time.monotonic()
        spent, drawing = cpu_time(page), sum(map(cpu_time, browser))
        time.sleep(self._seconds)
        passed = time.monotonic() - began
        used = usage(page)
        pictures, drawing = _pictures(shown) - drawn, sum(map(cpu_time, browser)) - drawing
        return {
            "real_time_factor": float(np.mean(self._factors[factors:] or [np.nan])),
            "page_cores": (cpu_time(page) - spent) / passed,
            "page_MB": used.rss if used is not None else np.nan,
            "pictures_per_s": pictures / passed,
            "browser_cores": drawing / passed,
            "browser_ms_per_picture": 1e3 * drawing / max(pictures, 1),
            "load": os.getloadavg()[0],
        }


def _pictures(page: Any) -> int:
    """That a page has drawn since it was opened."""
    return 0 if page is None else int(page.evaluate("window.pictures"))
