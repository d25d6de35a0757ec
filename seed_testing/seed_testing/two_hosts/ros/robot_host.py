# SPDX-License-Identifier: Apache-2.0
"""The computer at the arm: controller and simulated arm, and the client that plays and looks.

python -m seed_testing.two_hosts.ros.robot_host ADDRESS PEER SOCKET METHOD LOG

A line on its standard input is a case; a JSON line on its standard output is what came of it, or {"link": "cut"} and
{"link": "healed"}, which whoever has the link carries out.
"""

import json
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.qos import qos_profile_sensor_data
from seed_msgs.msg import ControllerState

from seed_bringup.demo.live import live_rates
from seed_bringup.ros.session import Played, SessionError
from seed_ros.conversions import seconds
from seed_testing.live.ros.cell import STARTS_WITHIN, Cell
from seed_testing.live.verdict import motion
from seed_testing.two_hosts.command import WANTED

TASK, PATIENCE = "squeegee", 90.0  # [s]
CUT_AFTER, CUT_FOR, SETTLES = 0.6, 2.0, 1.0  # [s] into the wipe; how long; from the last contact's begin
RECOVERS = 20.0  # [s] for enable to be granted after a cut


class Watcher:
    """What the robot's computer sees during a case."""

    def __init__(self, cell: Cell) -> None:
        self.cell, node = cell, cell.session.node
        self.ages: list[float] = []  # [s] of the newest estimate
        self.state = ControllerState()
        self.forces: list[tuple[float, float]] = []  # [s], [N] true force in z
        self.track: list[tuple[float, np.ndarray]] = []
        node.create_subscription(ControllerState, "controller/state", self._on_state, qos_profile_sensor_data)
        node.create_subscription(
            WrenchStamped, "sim/ground_truth/contact_wrench", self._on_wrench, qos_profile_sensor_data
        )
        node.create_subscription(PoseStamped, "current_pose", self._on_pose, qos_profile_sensor_data)

    def _on_state(self, message: ControllerState) -> None:
        self.state = self.cell.session.state = message  # by whose stamps the phases are told
        if message.enabled and np.isfinite(message.estimate_age):
            self.ages.append(message.estimate_age)

    def _on_wrench(self, message: WrenchStamped) -> None:
        self.forces.append((seconds(message.header.stamp), -message.wrench.force.z))

    def _on_pose(self, message: PoseStamped) -> None:
        p = message.pose.position
        self.track.append((seconds(message.header.stamp), np.array((p.x, p.y, p.z))))

    def clear(self) -> None:
        """A new case begins."""
        for values in (self.ages, self.forces, self.track):
            values.clear()

    def figures(self) -> dict[str, Any]:
        """Ages, what was lost, and the clocks."""
        ages = [round(1e3 * float(np.percentile(self.ages, p)), 1) for p in (50, 99)] if self.ages else [None, None]
        level, _, values = self.cell.said.get("controller", (0, "", {}))
        return {
            "age_ms": ages[0],
            "age_p99_ms": ages[1],
            "skew_ms": values.get("clock_skew_ms", ""),
            "within_ms": values.get("clock_skew_within_ms", ""),
            "level": level,
        }

    def wiped(self) -> float | None:
        """Rms of the true force's error while it wiped, a second after it began [N]."""
        phases = dict(self.cell.session.played.phases)
        if "wipe" not in phases:
            return None
        end = min((at for at in phases.values() if at > phases["wipe"]), default=time.time())
        errors = [f - WANTED for t, f in self.forces if phases["wipe"] + SETTLES < t < end]
        return round(float(np.sqrt(np.mean(np.square(errors)))), 3) if errors else None


def play(watcher: Watcher, also: Any = None) -> dict[str, Any]:
    """One task, to its end; `also` is called often."""
    cell, session = watcher.cell, watcher.cell.session
    watcher.clear()
    session.played = Played()
    cell.also = also or (lambda: None)
    try:
        cell.enable()
        played = session.play(TASK, None, lambda _: None, PATIENCE)
        ended = "" if played.result.success else str(played.result.message)
    except SessionError as error:
        ended = str(error)
    finally:
        cell.also = lambda: None
    largest = max((f for _, f in watcher.forces), default=0.0)
    return watcher.figures() | {"ended": ended, "force_rms_n": watcher.wiped(), "force_max_n": round(largest, 2)}


def cut(watcher: Watcher) -> dict[str, Any]:
    """A task whose link is cut while it wipes; then the link comes back, and enable is asked for."""
    session, at = watcher.cell.session, [0.0]

    def look() -> None:
        phases = dict(session.played.phases)
        if not at[0] and "wipe" in phases and time.time() > phases["wipe"] + CUT_AFTER:
            at[0] = time.time()
            tell({"link": "cut"})

    row = play(watcher, look)
    if not at[0]:
        tell({"link": "healed"})
        return row
    session.spin(CUT_FOR)
    reason = watcher.state.reason
    times, places = [t for t, _ in watcher.track], [p for _, p in watcher.track]
    seen = motion(times, places, at[0], at[0] + 1.5)
    largest = max((f for t, f in watcher.forces if t > at[0]), default=float("nan"))
    refused = _enable(watcher)
    tell({"link": "healed"})
    healed = time.monotonic()
    back = ""
    while time.monotonic() < healed + RECOVERS:
        session.spin(0.1)
        if not (back := _enable(watcher)):
            break
    after = round(time.monotonic() - healed, 1)
    return row | {
        "held_after_s": round(seen.held_after, 3),
        "travel_mm": round(1e3 * seen.travel, 1),
        "blind_s": round(seen.blind, 3),
        "force_max_n": round(largest, 2),
        "hold": reason,
        "enable_while_cut": refused or "granted",
        "enabled_after_s": after if not back else f"not within {RECOVERS:g} s: {back}",
    }


def _enable(watcher: Watcher) -> str:
    """Why enable was refused; '' if it was granted."""
    try:
        watcher.cell.session.switch("controller/enable", True)
    except SessionError as error:
        return str(error)
    return ""


def tell(what: dict[str, Any]) -> None:
    """To whoever started this."""
    print(json.dumps(what), flush=True)


def main() -> None:
    """Command line."""
    address, peer, socket, method, log = sys.argv[1:]
    _, loop_rate = live_rates()
    with ExitStack() as stack:
        settings = stack.enter_context(tempfile.NamedTemporaryFile("w", suffix=".yaml"))
        yaml.safe_dump({"controller": {"ros__parameters": {"rate": loop_rate}}}, settings)
        settings.flush()
        arguments = {"address": address, "peers": peer, "links": "false", "sim_rate": str(loop_rate)}
        arguments |= {"controller_file": settings.name}
        cell = Cell(arguments, Path(log), launch_file="robot_host")
        cell.images = method != "truth"
        stack.enter_context(cell)
        world = [sys.executable, "-P", "-m", "seed_testing.two_hosts.ros.world", "send", socket]
        sender = subprocess.Popen(world)
        stack.callback(sender.wait)
        stack.callback(sender.terminate)
        watcher = Watcher(cell)
        try:
            cell.session.trigger("sim/reset", patience=STARTS_WITHIN)
            cell.session.spin(1.0)
            cell.prepare()
            tell({"ready": True})
        except SessionError as error:
            tell({"failed": str(error)})
            return
        for line in sys.stdin:
            tell(cut(watcher) if line.strip() == "cut" else play(watcher))
            with suppress(SessionError):
                cell.recover()


if __name__ == "__main__":
    main()
