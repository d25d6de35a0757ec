# SPDX-License-Identifier: Apache-2.0
"""What makes the page light for a browser that draws in software: a script that is put into it before viser's own.

Viser's page draws the 3-D view as often as the screen is refreshed, with smoothed edges. On a computer without a
graphics card that takes all of a core, which the cell wants. There the script draws fewer pictures, with plain edges; a
browser with a graphics card is left alone.
"""

import http
from collections.abc import Callable
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

Answer = Callable[[ServerConnection, Request], Response | None]

SCRIPT = """<script>
(() => {
  const PERIOD = 66;  // ms between two pictures: every one of the cell's, and hardly one twice
  const OPENING = 4000;  // ms in which the page is put together, picture by picture
  const plainContext = HTMLCanvasElement.prototype.getContext;
  const inSoftware = () => {
    const gl = plainContext.call(document.createElement('canvas'), 'webgl2');
    const told = gl && gl.getExtension('WEBGL_debug_renderer_info');
    return Boolean(told) && /swiftshader|llvmpipe|software|basic render/i.test(
      gl.getParameter(told.UNMASKED_RENDERER_WEBGL));
  };
  const slow = inSoftware();
  document.documentElement.dataset.drawnIn = slow ? 'software' : 'hardware';
  if (!slow) return;
  HTMLCanvasElement.prototype.getContext = function (kind, settings) {
    return plainContext.call(this, kind, kind.startsWith('webgl') ? {...settings, antialias: false} : settings);
  };
  const request = window.requestAnimationFrame.bind(window), cancel = window.cancelAnimationFrame.bind(window);
  const waiting = new Map();  // what ends the wait of each request
  let count = 0, last = -PERIOD;
  window.requestAnimationFrame = (callback) => {
    const id = ++count, due = last + PERIOD;
    const draw = () => {
      const frame = request((t) => {
        waiting.delete(id);
        last = Math.max(last, t, Math.min(due, performance.now()));  // t of a busy browser lags behind
        callback(t);
      });
      waiting.set(id, () => cancel(frame));
    };
    const now = performance.now(), wait = now < OPENING ? 0 : due - now;
    if (wait > 0) {
      const timer = setTimeout(draw, wait);
      waiting.set(id, () => clearTimeout(timer));
    } else {
      draw();  // at once: a busy browser may be late with a timer
    }
    return id;
  };
  window.cancelAnimationFrame = (id) => {
    if (waiting.has(id)) waiting.get(id)();
    waiting.delete(id);
  };
})();
</script>"""


def with_script(answer: Answer) -> Answer:
    """The same answers to a browser's requests, with the script at the head of the page."""

    def answer_with_script(connection: ServerConnection, request: Request) -> Response | None:
        if "Accept-Encoding" in request.headers:  # on loopback packing costs more than it saves
            del request.headers["Accept-Encoding"]
        found = answer(connection, request)
        if found is not None and found.status_code == http.HTTPStatus.OK and _is_page(found.headers):
            found.body = found.body.replace(b"<head>", b"<head>" + SCRIPT.encode(), 1)
            del found.headers["Content-Length"]
            found.headers["Content-Length"] = str(len(found.body))
        return found

    return answer_with_script


def _is_page(headers: Any) -> bool:
    return bool(headers.get("Content-Type", "").startswith("text/html"))
