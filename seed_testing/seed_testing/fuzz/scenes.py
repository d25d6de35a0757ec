# SPDX-License-Identifier: Apache-2.0
"""What stands around each node while it is fuzzed: good inputs, and what brings it to where it works."""

import math
import time
from collections.abc import Callable
from functools import cache
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message
from seed_msgs.msg import HybridSetpoint
from std_srvs.srv import Trigger

from seed_control.tasks.load import shipped_tasks
from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, FINGERS, GRAVITY, Hand, Tool
from seed_core.spatial import Wrench, inverse_pose, make_pose, pose_from_rpy
from seed_ros.conversions import (
    estimate_to_message,
    fill_pose,
    pose_stamped,
    pose_to_matrix,
    wrench_stamped,
)
from seed_ros.images import Intrinsics, camera_info, image_message
from seed_testing.fuzz.subject import Subject
from seed_testing.interfaces import NODES
from seed_ur.standin_client import StandIn

X_W_TIP = pose_from_rpy((math.pi, 0.0, 0.0), (0.45, 0.0, 0.1))
X_WE = X_W_TIP @ inverse_pose(Tool().X_Ttip) @ inverse_pose(Hand().X_EC)
IMAGE_STRIDE = 2  # small images: more of them, and the same code


class ArmScene(Subject):
    """Poses of an arm that goes where it is sent, and of a tool that hangs in the grasp."""

    target = "target_frame"
    pressed = 0.0  # [N] that the tool is pushed up with

    @property
    def X_WE(self) -> Any:
        """Where the arm is (4, 4)."""
        sent = self.said.get(self.target)
        return X_WE if sent is None else pose_to_matrix(sent.pose)

    def estimate(self) -> Any:
        """relative_pose of a tool that hangs, with the motion of both membranes."""
        K = np.array(DEFAULT_STIFFNESS.translation)
        load = np.array((0.0, 0.0, self.pressed - Tool().mass * GRAVITY))
        X_CT = make_pose(None, self.X_WE[:3, :3].T @ load / K)
        small = np.diag([1e-8] * 6)
        motions = tuple(MembraneMotion(f, X_CT, small, deformation=np.zeros(9), pressure=1030.0) for f in FINGERS)
        told = RelativePoseEstimate(self.now, X_CT, small, method="test", membrane=motions)
        return estimate_to_message(told, "compliance", "tool")

    def good(self, rng: Random, name: str, kind: Any) -> Any:
        """A pose, a wrench, a set-point or a task that fits."""
        if name == "relative_pose":
            return self.estimate()
        if kind.__name__ == "PoseStamped":
            return pose_stamped(self.X_WE, self.now, "base")
        if kind.__name__ == "WrenchStamped":
            return wrench_stamped(Wrench.zero(), self.now, "tool0")
        made = kind()
        if name in ("~/setpoint", "~/relative_pose_setpoint"):
            made.header.frame_id = "base" if name == "~/setpoint" else "tool"
            fill_pose(made.pose, X_W_TIP if name == "~/setpoint" else make_pose(None, (0.0, 0.0, 0.002)))
        if hasattr(made, "wrench"):
            made.header.frame_id = "base"
            made.wrench.force.z = -rng.uniform(0.0, 10.0)
        if hasattr(made, "force_projector"):
            made.force_projector = [0.0] * 8 + [1.0]
        if kind.__name__ == "FollowSetpoints_Goal":
            tasks = shipped_tasks()
            named = rng.choice(list(tasks))
            made.task = named if rng.random() < 0.5 else tasks[named].read_text(encoding="utf-8")
        return made

    def ask(self, name: str, *values: Any) -> None:
        """Call one of the node's services well."""
        service = next(s for s in self.node.services if s.srv_name.endswith(name))
        request = service.srv_type.Request(**dict(zip(("data",), values, strict=False)))
        self._run(service.callback(request, service.srv_type.Response()))
        self.turn(2)


class ControllerScene(ArmScene):
    """The controller, enabled, with an arm that follows."""

    parameters = {"clocks": "simulated"}

    def prepare(self) -> None:
        """The callbacks of what always comes."""
        calls = {s.topic_name: call for s, call in self.node.loop.streams.items()}
        self._pose, self._relative = calls["/current_pose"], calls["/relative_pose"]
        self._hybrid = calls["/controller/setpoint"]
        self._turns = 0

    def background(self) -> None:
        """The streams of arm and estimator."""
        self._turns += 1
        self._pose(pose_stamped(self.X_WE, self.now, "base"), {})
        if self._turns % 5 == 0:
            self._relative(self.estimate(), {})

    def calm(self) -> None:
        """Good poses for a while, enable, and a set-point that presses more or less."""
        for goal in self.goals:
            goal.is_cancel_requested = True
        self.pressed = float(self._turns % 4) * 2.0
        self.ask("enable", False)
        for _ in range(12):
            self.background()
            self.turn()
        self.ask("enable", True)
        if self._turns % 3:
            self._hybrid(self.good(Random(self._turns), "~/setpoint", HybridSetpoint), {})
        for _ in range(5):
            self.background()
            self.turn()


class GuardScene(ArmScene):
    """The guard, following."""

    target = "guarded_frame"

    def calm(self) -> None:
        """Good poses of an arm that stands, then resend."""
        calls = {s.topic_name: call for s, call in self.node.loop.streams.items()}
        for _ in range(7):
            calls["/current_pose"](pose_stamped(self.X_WE, self.now, "base"), {})
            time.sleep(0.04)
        self.ask("resend_robot_program")


class SimScene(ArmScene):
    """The simulated cell with its tool grasped."""

    parameters = {"relative_pose": True}
    target = "current_pose"
    every = 10

    def calm(self) -> None:
        """Back to the start, tool grasped."""
        for name in ("~/reset", "~/resend_robot_program", "~/grasp"):
            self.ask(name.removeprefix("~/"))


class IdentificationScene(ArmScene):
    """The identification node, and its simulated cell."""

    def prepare(self) -> None:
        """Results go where nobody looks."""
        self._folder = TemporaryDirectory()

    def drawn(self, rng: Random, name: str, kind: Any) -> Any:
        """Goals into folders of their own, whatever they name."""
        made = super().drawn(rng, name, kind)
        if hasattr(made, "output"):
            given = made.output.replace("/", "_").replace("..", "_")
            made.output = f"{self._folder.name}/{given or rng.randrange(5)}"
        return made

    def close(self) -> None:
        """And the folder."""
        super().close()
        self._folder.cleanup()


class DriverScene(ArmScene):
    """The driver, following a stand-in controller."""

    target = "current_pose"

    def __init__(self, kind: Any) -> None:
        self._robot = StandIn()
        self.parameters = {"robot_ip": self._robot.host}
        try:
            super().__init__(kind)
        except BaseException:
            self._robot.close()
            raise

    def prepare(self) -> None:
        """Active, once before its outputs are overheard."""
        self.node.trigger_configure()
        self.node.trigger_activate()

    def calm(self) -> None:
        """Active, and following again."""
        state = self.node.supervisor and self.node.supervisor.state
        if state is None:
            self.node.trigger_configure()
            self.node.trigger_activate()
        elif state.armed:
            return
        if state is not None:
            self.ask("resend_robot_program")
        self.overhear()
        self.bench.until(lambda: self.node.supervisor and self.node.supervisor.state.armed, 2.0)

    def close(self) -> None:
        """And the stand-in."""
        super().close()
        self._robot.close()


class EstimatorScene(Subject):
    """The estimator with small images of a tool that is grasped."""

    parameters = {"reference_frames": 2, "grasp_frames": 2, "clocks": "simulated"}

    def _image(self, finger: str, what: str, which: int) -> Any:
        depth, ir = pictures()[which][finger]
        pixels, encoding = (depth, "32FC1") if what == "depth" else (ir, "mono16")
        return image_message(pixels, encoding, self.now, f"bubble_{finger}_optical")

    def good(self, rng: Random, name: str, kind: Any) -> Any:
        """Images and their calibration."""
        finger = "left" if "left" in name else "right"
        if kind.__name__ == "Image":
            return self._image(finger, "depth" if "/depth/" in name else "ir", rng.randrange(len(pictures())))
        if kind.__name__ == "CameraInfo":
            return camera_info(intrinsics()[finger], self.now, f"bubble_{finger}_optical")
        return kind()

    def calm(self) -> None:
        """A reference, a grasp, and images of it."""
        self._shoot(0)
        for name, which in (("capture_reference", 0), ("initialize_grasp", 1)):
            self._shoot(which)
            service = next(s for s in self.node.services if s.srv_name.endswith(name))
            self._run(service.callback(Trigger.Request(), Trigger.Response()))
            self.turn(3)
            for _ in range(3):
                self._shoot(which)
        for which in range(len(pictures())):
            self._shoot(which)

    def _shoot(self, which: int) -> None:
        self.now += 0.04
        self._turn_clock()
        streams = self.node.loop.streams.items()
        for subscription, call in sorted(streams, key=lambda s: "info" not in s[0].topic_name):
            name = self.short(subscription.topic_name)
            if name.startswith("bubble_"):
                self._exactly(subscription, call, name, which)
        self.turn()

    def _exactly(self, subscription: Any, call: Callable[[Any, Any], None], name: str, which: int) -> None:
        """What a camera sends."""
        finger = "left" if "left" in name else "right"
        if subscription.raw:
            call(serialize_message(self._image(finger, "depth" if "/depth/" in name else "ir", which)), {})
        else:
            call(camera_info(intrinsics()[finger], self.now, f"bubble_{finger}_optical"), {})


@cache
def _renderer() -> Any:
    from seed_sim.tactile import TactileParameters, TactileRenderer

    return TactileRenderer(TactileParameters(), Hand(), seed=4)


@cache
def intrinsics() -> dict[str, Intrinsics]:
    """Of the small images, by finger."""
    out = {}
    for finger, c in _renderer().cameras.items():
        depth, _ = pictures()[0][finger]
        K = np.diag((1.0 / IMAGE_STRIDE, 1.0 / IMAGE_STRIDE, 1.0)) @ c.K
        out[finger] = Intrinsics(depth.shape[1], depth.shape[0], K.ravel().tolist(), list(c.D), c.model)
    return out


@cache
def pictures() -> list[dict[str, tuple[Any, Any]]]:
    """Depth [m] and infrared [counts] by finger: without contact, grasped, pressed."""
    poses = (None, np.eye(4), make_pose(None, (0.002, 0.0, -0.003)))
    shown = [_renderer().no_contact(0.0) if X is None else _renderer().render(X, 0.1 * i) for i, X in enumerate(poses)]
    n = IMAGE_STRIDE
    return [
        {f: (np.ascontiguousarray(p.depth[::n, ::n]), p.ir[::n, ::n].astype(np.uint16)) for f, p in pair.items()}
        for pair in shown
    ]


class LinkScene(Subject):
    """The frames of the arm's links."""

    def good(self, rng: Random, name: str, kind: Any) -> Any:  # noqa: ARG002
        """Angles of six joints."""
        made = kind()
        if hasattr(made, "position"):
            made.name = [j.name for j in self.node.joints if j.moves]
            made.position = [rng.uniform(-3.0, 3.0) for _ in made.name]
        return made


class BubblesScene(ArmScene):
    """The simulated cameras; each truth may be a picture."""

    parameters = {"rate": 5.0}


class PageScene(EstimatorScene):
    """The operator page with images and states, and nobody who looks."""

    parameters = {"port": 0}

    def calm(self) -> None:
        """Nothing to prepare."""


class CamerasScene(Subject):
    """The RealSense node, which hears nothing, without a camera."""

    parameters = {}


SCENES: dict[str, tuple[type[Subject], int]] = {  # and how many in a hundred inputs are theirs
    "controller": (ControllerScene, 24),
    "estimator": (EstimatorScene, 10),
    "driver": (DriverScene, 12),
    "guard": (GuardScene, 10),
    "sim": (SimScene, 8),
    "bubbles": (BubblesScene, 2),
    "sysid": (IdentificationScene, 8),
    "identification_cell": (IdentificationScene, 4),
    "link_frames": (LinkScene, 2),
    "page": (PageScene, 8),
    "cameras": (CamerasScene, 2),
}


def subject(name: str) -> Subject:
    """A node of NODES with its surroundings."""
    return SCENES[name][0](NODES[name][0])
