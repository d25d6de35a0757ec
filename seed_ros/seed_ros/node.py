# SPDX-License-Identifier: Apache-2.0
"""Base class of the suite's nodes: parameters, clock, counters, topics, services, transforms, diagnostics, main.

A node reads from top to bottom: parameters, outputs, inputs, services, then what it does at each tick of its loop.
Mathematics is in the cores, which know nothing of ROS.
"""

import contextlib
import gc
import inspect
import os
import signal
import sys
import warnings
from collections.abc import Awaitable, Callable
from typing import Any

import rclpy
from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.exceptions import NotInitializedException, ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.service import Service
from tf2_msgs.msg import TFMessage

from seed_core.errors import SeedError, os_error_words
from seed_ros import parameters
from seed_ros.diagnostics import Beats, Counters, Diagnostics, Report
from seed_ros.loop import FixedRateLoop
from seed_ros.qos import LATCHED, TF, QosMismatch
from seed_ros.services.answers import resend_unsent_answers
from seed_ros.services.standard import harden_standard_services

QUIET = PublisherEventCallbacks(use_default_callbacks=False)  # each event handler is one more thing to wait for


def client_node(name: str, **arguments: Any) -> Node:
    """A node that calls and listens and offers no service, of which SROS 2 would have to know; as rclpy's Node."""
    silent = Parameter("start_type_description_service", value=False)
    return Node(name, start_parameter_services=False, parameter_overrides=[silent], **arguments)


class SeedNode(Node):
    """A node of the suite.

    Attributes:
        loop: runs the node; made by each node, with its rate and what is done at each tick.
        counters: what was refused, by cause.
        beats: of the node's main output, for the diagnostics.
    """

    loop: FixedRateLoop

    def __init__(self, name: str, **arguments: Any) -> None:
        """Arguments are those of rclpy's Node."""
        self.ranges: dict[str, Any] = {}  # fields of the parameters, by name
        self._actions: list[ActionServer] = []
        super().__init__(name, **arguments)
        self.add_on_set_parameters_callback(parameters.checking(self._keep_clock))
        harden_standard_services(self)
        self.counters = Counters(self)
        self.beats = Beats()

    declare = parameters.declare
    refuse_unknown = parameters.refuse_unknown

    def _keep_clock(self, changes: list[Parameter]) -> None:
        """Raises SeedError: the clock is to be another one, which no stamp so far was of."""
        for change in changes:
            if change.name == "use_sim_time" and change.value != self.get_parameter("use_sim_time").value:
                raise SeedError("use_sim_time cannot be changed while the node runs: give it at its start")

    def describe_parameters(self, names: list[str]) -> list[ParameterDescriptor]:
        """As rclpy does, with the range that each parameter is checked against."""
        told = zip(names, super().describe_parameters(names), strict=True)
        return [parameters.with_range(d, self.ranges[n]) if n in self.ranges else d for n, d in told]

    def now(self) -> float:
        """ROS time [s]."""
        return float(self.get_clock().now().nanoseconds * 1e-9)

    # topics
    def publisher(self, kind: Any, topic: str, qos: QoSProfile) -> Publisher:
        """As create_publisher, without handlers of its events."""
        return self.create_publisher(kind, topic, qos, event_callbacks=QUIET)

    def listen(self, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile, refused: str) -> None:
        """Poll a topic in the node's loop; a SeedError of the callback counts under `refused`."""

        def receive(message: Any) -> None:
            with self.counters.refusing(refused):
                callback(message)

        self.loop.poll(kind, topic, receive, qos)

    # services and actions
    def create_service(self, *arguments: Any, **named: Any) -> Service:
        """As rclpy's; an answer is sent again while the middleware does not know yet who asked."""
        service = super().create_service(*arguments, **named)
        resend_unsent_answers(self, service)
        return service

    def serve(
        self, kind: Any, name: str, method: Callable[..., Any], group: CallbackGroup | None = None, log_as: str = ""
    ) -> None:
        """Offer a service whose response has `success` and `message`, such as Trigger and SetBool.

        Args:
            kind: its type.
            name: its name.
            method: gets the request's fields and returns the message, or raises SeedError with the words of a
                refusal, or OSError where a file or the disk is in the way; a coroutine may wait for each, and others
                are served meanwhile if the group is reentrant.
            group: callback group.
            log_as: what the answer is logged under; empty: not logged.
        """

        async def answer(request: Any, response: Any) -> Any:
            try:
                words = method(*(getattr(request, field) for field in request.get_fields_and_field_types()))
                response.message = await words if isinstance(words, Awaitable) else words
                response.success = True
            except SeedError as error:
                response.success, response.message = False, str(error)
            except OSError as error:
                response.success, response.message = False, os_error_words(error)
            if log_as:
                self.tell(response.success, f"{log_as}: {response.message}")
            return response

        self.create_service(kind, name, answer, callback_group=group)

    def serve_action(self, kind: Any, name: str, execute: Callable[[Any], Awaitable[Any]]) -> ActionServer:
        """Offer an action. Every goal is accepted, as a refusal needs words, which only a result has."""
        server = ActionServer(
            self,
            kind,
            name,
            execute_callback=execute,
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self._actions.append(server)
        return server

    def destroy_node(self) -> None:
        """As rclpy's, which leaves actions offered until the collector comes by."""
        while self._actions:
            self._actions.pop().destroy()
        super().destroy_node()

    def tell(self, success: bool, words: str) -> None:
        """Log how something ended. rclpy wants one severity per line of code."""
        if success:
            self.get_logger().info(words)
        else:
            self.get_logger().error(words)

    # health
    def diagnose(self, hardware_id: str, report: Callable[[], Report]) -> None:
        """Publish level, message and values that `report()` returns on /diagnostics, once a second.

        Publishers that cannot be heard are told of as often.
        """
        mismatch = QosMismatch(self, self.counters)

        def looked() -> Report:
            mismatch.look()
            return report()

        self._diagnostics = Diagnostics(self, hardware_id, looked, self.beats, self.counters)

    @classmethod
    def main(cls) -> int:
        """Run a node of this class until it is interrupted; the exit code."""
        return run(cls)


class TransformBroadcaster:
    """Transforms on /tf and /tf_static, which are only topics of type tf2_msgs/TFMessage: tf2_ros is not needed."""

    def __init__(self, node: Node, moving: bool = True, fixed: bool = True) -> None:
        """moving, fixed: which of /tf and /tf_static will be sent."""
        self._moving = node.create_publisher(TFMessage, "/tf", TF, event_callbacks=QUIET) if moving else None
        self._fixed = node.create_publisher(TFMessage, "/tf_static", LATCHED, event_callbacks=QUIET) if fixed else None
        self._kept: dict[str, TransformStamped] = {}

    def send(self, *transforms: TransformStamped) -> None:
        """Moving transforms."""
        assert self._moving is not None
        self._moving.publish(TFMessage(transforms=list(transforms)))

    def send_static(self, *transforms: TransformStamped) -> None:
        """Fixed transforms; those sent before stay."""
        assert self._fixed is not None
        self._kept.update({t.child_frame_id: t for t in transforms})
        self._fixed.publish(TFMessage(transforms=list(self._kept.values())))


def no_security(error: Exception) -> str:
    """What it means that the middleware cannot do what ROS_SECURITY_ENABLE asks for; '' for another error."""
    if os.environ.get("ROS_SECURITY_ENABLE") != "true":  # rcl takes no other word
        return ""
    if "security libraries" in str(error):
        return (
            "ROS_SECURITY_ENABLE is set, and this Fast DDS was built without its security libraries, as the wheels' "
            "is: take ROS 2 from apt (SEED_ROS=/opt/ros/jazzy), or unset it"
        )
    if "failed to initialize rcl" in str(error) or "SECURITY ERROR" in str(error):
        store = os.environ.get("ROS_SECURITY_KEYSTORE", "")
        enclave = os.environ.get("ROS_SECURITY_ENCLAVE_OVERRIDE", "/")
        return (
            f"ROS_SECURITY_ENABLE is set, and the keystore ROS_SECURITY_KEYSTORE='{store}' has no enclave {enclave} "
            "that can be used: make one with ./seed access FOLDER"
        )
    return ""


def run(create: Callable[[], SeedNode], argv: list[str] | None = None) -> int:
    """Create a node, run its loop until the end, and say in one line why it could not start.

    Returns:
        The exit code.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    starting, interrupted = True, False

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        interrupted = True
        if starting:
            raise KeyboardInterrupt

    def complain(what: Any) -> None:
        if rclpy.ok():
            sys.__unraisablehook__(what)

    warn = warnings.showwarning

    def advise(*what: Any, **where: Any) -> None:
        if rclpy.ok():
            warn(*what, **where)

    # What rclpy was making when its context ended is half made: its __del__ fails, and its end is warned of.
    sys.unraisablehook, warnings.showwarning = complain, advise
    signal.signal(signal.SIGINT, interrupt)  # rclpy ends the context before; the loop looks for that, so need not break
    try:
        rclpy.init(args=argv)
    except RuntimeError as error:  # a file of parameters that cannot be read, a remapping that is none
        print(f"error: {no_security(error) or error}", file=sys.stderr)
        return 1
    node: SeedNode | None = None
    try:
        node = create()
        inspect.getframeinfo(sys._getframe())  # each logger's first line looks up all modules' files, 0.1 s: do it now
        gc.freeze()  # what was loaded so far stays: the collector need not walk it in a control loop
        starting = False
        node.loop.run()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (RuntimeError, ValueError, NotInitializedException) as error:
        # an interrupt in the middle of taking or publishing a message (RCLError is a RuntimeError), or of making an
        # action (ValueError) or a second node
        if why := no_security(error):
            print(f"error: {why}", file=sys.stderr)
            return 1
        if rclpy.ok():
            raise
    except (SeedError, ParameterException) as error:  # the latter: of a type that rclpy does not let in
        if not interrupted:  # else that was in the middle of an import
            print(f"error: {error}", file=sys.stderr)
            return 1
    finally:
        starting = False  # Ctrl-C comes twice below `ros2 launch`: the node is ending
        if node is not None:
            node.destroy_node()
        with contextlib.suppress(RuntimeError):  # rclpy's own thread may end the context in the same moment
            rclpy.try_shutdown()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Python's own end would let it kill
    return 0
