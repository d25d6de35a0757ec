# SPDX-License-Identifier: Apache-2.0
"""Nonsense through the middleware: published by another node, taken by the node's own loop."""

import time
import traceback
import warnings
from random import Random

from rcl_interfaces.srv import ListParameters

from seed_ros.qos import QUEUE
from seed_testing.fuzz.run import CALM, Failure, Findings
from seed_testing.fuzz.scenes import subject
from seed_testing.fuzz.subject import Step

TOGETHER = 10  # messages to each look of the node
PATIENCE = 10.0  # [s] for both nodes to find each other


def through_the_wire(name: str, inputs: int, seed: int) -> Findings:
    """Publish messages to the node of that name; at the end it has to answer a service still."""
    rng, found = Random(f"{seed} {name} by wire"), Findings()
    with subject(name) as under, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        client = under.bench.client
        kinds = {
            under.short(s.topic_name): s
            for s in under.node.subscriptions
            if s.topic_name not in ("/clock", "/parameter_events")
        }
        outputs = {n: client.create_publisher(s.msg_type, s.topic_name, QUEUE) for n, s in kinds.items()}
        under.bench.until(lambda: all(o.get_subscription_count() for o in outputs.values()), PATIENCE)
        try:
            for number in range(inputs):
                topic = rng.choice(list(outputs))
                outputs[topic].publish(under.drawn(rng, topic, kinds[topic].msg_type))
                if number % (CALM * TOGETHER) == 0:
                    under.calm()
                if number % TOGETHER == 0:
                    began = time.thread_time()
                    under.bench.turn()
                    found.longest = max(found.longest, time.thread_time() - began)
            under.turn(3)
            under.bench.call(ListParameters, f"{under.node.get_name()}/list_parameters", ListParameters.Request())
        except Exception as error:  # anything: that is what is looked for
            words = f"{type(error).__name__}: {error!s:.80}"
            found.failures[words] = Failure(words, [Step("in", topic, seed)], traceback.format_exc())
        found.inputs = inputs
    return found
