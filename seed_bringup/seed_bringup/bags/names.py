# SPDX-License-Identifier: Apache-2.0
"""Names of topics, checked before anything is opened."""

from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_topic_name import validate_topic_name

from seed_bringup.bags import BagError


def check_topic(name: str, namespace: str) -> None:
    """Raises BagError: ROS has no topic of such a name; namespace: of names without a slash at their beginning."""
    try:
        validate_topic_name(name)
        validate_full_topic_name(expand_topic_name(name, "seed_bag", namespace))
    except (InvalidTopicNameException, ValueError) as error:
        why = str(error).splitlines()[0].partition(", at ")[0].removeprefix("Invalid topic name: ").rstrip(":")
        raise BagError(f"'{name:.100}' names no topic: {why}") from error
