# SPDX-License-Identifier: Apache-2.0
"""The picture of the operator page in the documents: python -m seed_testing.live.page_picture docs/images/page.png

Starts the simulated cell with its page, presses the page's own buttons in a browser, and takes the picture while the
task wipes.
"""

import time
from pathlib import Path

from seed_bringup.launching.domains import OWN, claimed
from seed_bringup.launching.launcher import Launch
from seed_bringup.launching.packages import find_launch_file
from seed_bringup.page.browser import FLAGS, browser
from seed_core.errors import FailedError
from seed_core.program.command_line import Parser, command

WIDTH, HEIGHT = 1440, 860  # [px]
PATIENCE = 120.0  # [s] for the cell; for each thing that the page is to show
ARGUMENTS = {"view": "true", "view_port": "0", "links": "false", "use_sim_time": "true", "camera_rate": "15.0"}


@command("page_picture")
def main(argv: list[str]) -> int:
    """Take the picture."""
    p = Parser(prog="page_picture", description=__doc__)
    p.add_argument("file", type=Path, help="PNG to write")
    p.add_argument("--then", type=float, default=0.5, help="[s] from the beginning of the wipe to the picture")
    options = p.parse_args(argv)
    program = browser()
    lines: list[str] = []
    slow = ARGUMENTS | {"sim_rate": "125.0", "command_timeout": "0.5"}
    with (
        claimed(OWN, "page_picture"),
        Launch(find_launch_file(["cell"]), slow, output=lambda label, line: lines.append(f"[{label}] {line}")),
    ):
        deadline = time.monotonic() + PATIENCE
        while not (found := [line for line in lines if line.startswith("[page]") and "http://" in line]):
            if time.monotonic() > deadline:
                raise FailedError("the page did not start: " + " | ".join(lines[-5:]))
            time.sleep(0.1)
        _press_and_picture(found[0].split()[-1], program, options.file, options.then)
    print(f"wrote {options.file}")
    return 0


def _press_and_picture(address: str, program: str, file: Path, then: float) -> None:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        chromium = p.chromium.launch(executable_path=program, args=list(FLAGS))
        page = chromium.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.set_default_timeout(1e3 * PATIENCE)
        page.goto(address)
        for button, done in (("Reference", "Next: Grasp"), ("Grasp", "Next: Enable"), ("Enable", "Ready")):
            page.get_by_role("button", name=button, exact=True).click()
            page.get_by_text(done).first.wait_for()
        page.get_by_label("Task").click()
        page.get_by_role("option", name="squeegee").click()
        page.get_by_role("button", name="Play task").click()
        page.get_by_text("squeegee: wipe").wait_for()
        time.sleep(then)
        page.screenshot(path=str(file))
        chromium.close()


if __name__ == "__main__":
    raise SystemExit(main())
