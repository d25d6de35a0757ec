# SPDX-License-Identifier: Apache-2.0
"""The policy that ships is that of the documented interfaces."""

from pathlib import Path

from seed_testing.policies import policy, rights_of_nodes

ROOT = Path(__file__).parents[2]
DOCUMENT = (ROOT / "docs/interfaces.md").read_text(encoding="utf-8")


def test_the_policy_is_that_of_the_document() -> None:
    written = (ROOT / "seed_bringup/config/access/cell.policy.xml").read_text(encoding="utf-8")
    made = "python -m seed_testing.policies docs/interfaces.md seed_bringup/config/access/cell.policy.xml"
    assert written == policy(DOCUMENT), f"run: {made}"


def test_private_remapped_and_absolute_names_are_resolved() -> None:
    rights = rights_of_nodes(DOCUMENT)
    assert "/controller/state" in rights["controller"]["topics", "publish", "topic"]
    assert "/sim/hold_reason" in rights["controller"]["topics", "subscribe", "topic"]
    assert "/tf_static" in rights["estimator"]["topics", "publish", "topic"]
    assert "/gripper_controller/gripper_cmd" in rights["gripper_action"]["actions", "call", "action"]
    assert "/bubble_left/pressure" in rights["controller"]["topics", "subscribe", "topic"]
    assert "/gripper/force_command" in rights["controller"]["topics", "publish", "topic"]
    assert "/driver/change_state" in rights["driver"]["services", "reply", "service"]
