# SPDX-License-Identifier: Apache-2.0
"""The latched hold: silence, refusals and requests end the motion, and only a request starts it again."""

from hypothesis import given
from hypothesis import strategies as st

from seed_core.arm.hold import HoldLatch

PATIENCE = 0.1  # [s]


def test_silence_is_a_hold() -> None:
    latch = HoldLatch(PATIENCE)
    latch.check(10.0)
    assert not latch.reason  # nothing to follow yet
    latch.heard(10.0)
    latch.check(10.0 + 0.09)
    assert latch.following
    latch.check(10.0 + 0.11)
    assert latch.reason == "no target_frame for 0.1 s"


def test_a_held_arm_does_not_hear_until_it_is_resumed() -> None:
    latch = HoldLatch(PATIENCE)
    latch.hold("stopped on request")
    latch.heard(1.0)
    latch.check(9.0)
    assert not latch.following
    assert latch.reason == "stopped on request"
    latch.resume()
    assert not latch.reason
    assert not latch.following  # not before a target has come
    latch.heard(9.0)
    assert latch.following


def test_a_resumed_arm_waits_for_its_first_target_however_long_and_times_the_next() -> None:
    latch = HoldLatch(PATIENCE)
    latch.heard(1.0)
    latch.check(2.0, "this computer is busy")
    assert latch.reason == "no target_frame for 0.1 s (this computer is busy)"
    latch.resume()
    latch.check(60.0)
    assert not latch.reason
    latch.heard(60.0)
    latch.check(60.2)
    assert latch.reason == "no target_frame for 0.1 s"


def test_a_refusal_holds_only_what_is_being_followed() -> None:
    latch = HoldLatch(PATIENCE)
    latch.refused("a jump")
    assert not latch.reason
    latch.heard(1.0)
    latch.refused("a jump")
    assert latch.reason == "a jump"
    latch.refused("not finite")
    assert latch.reason == "a jump"  # the first is what ended the motion


def test_it_waits_for_its_first_resume_when_it_is_told_to() -> None:
    latch = HoldLatch(PATIENCE, "waiting for resend_robot_program")
    latch.heard(0.0)
    assert not latch.following
    latch.resume()
    latch.heard(0.0)
    assert latch.following


def test_the_newest_reason_to_hold_is_told() -> None:
    latch = HoldLatch(PATIENCE)
    latch.hold("protective stop")
    latch.hold("emergency stop")
    assert latch.reason == "emergency stop"


def test_an_error_without_words_is_a_hold_all_the_same() -> None:
    latch = HoldLatch(PATIENCE)
    latch.heard(0.0)
    latch.hold(str(RuntimeError()))
    latch.heard(0.01)
    assert not latch.following
    assert latch.reason


EVENTS = st.lists(st.sampled_from(["heard", "refused", "check", "hold", "resume"]), max_size=30)


@given(EVENTS, st.floats(0.0, 0.3))
def test_whatever_happens_motion_follows_only_on_a_target_after_the_last_hold(events: list[str], gap: float) -> None:
    latch, now, heard = HoldLatch(PATIENCE), 0.0, None
    held = False
    for event in events:
        now += gap
        match event:
            case "heard":
                latch.heard(now)
                heard = heard if held else now
            case "refused":
                latch.refused("refused")
                held = held or heard is not None
            case "check":
                latch.check(now)
                held = held or (heard is not None and now - heard > PATIENCE)
            case "hold":
                latch.hold("told to")
                held = True
            case "resume":
                latch.resume()
                held, heard = False, None
        assert latch.following == (not held and heard is not None)
        assert bool(latch.reason) == held
