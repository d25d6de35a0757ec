# SPDX-License-Identifier: Apache-2.0
"""What a demo and ./seed play say on the way, where there is no terminal."""

import pytest

from seed_bringup.demo.terminal import Bar, done_in


def test_a_lift_that_begins_while_the_tool_presses_ends_with_the_force_in_the_air(
    capsys: pytest.CaptureFixture[str],
) -> None:
    bar = Bar()
    for phase, progress, force in (("wipe", 0.64, 9.9), ("wipe", 0.7, 10.0), ("lift after cancel", 0.77, 9.98)):
        bar.show(phase, progress, force)
    bar.show("lift after cancel", 0.77, 0.02)
    bar.close()
    bar.close()  # nothing is left to tell
    assert capsys.readouterr().out.splitlines() == [
        "  wipe               64 %   estimated force   9.90 N as it begins",
        "  lift after cancel  77 %   estimated force   9.98 N as it begins",
        "  lift after cancel  77 %   estimated force   0.02 N as it ends",
    ]


def test_a_task_that_controls_no_force_ends_without_one() -> None:
    assert done_in(9.64, 0.101) == "done in 9.6 s; estimated force within 0.10 N rms of what was wanted"
    assert done_in(9.64, float("nan")) == "done in 9.6 s"
