# SPDX-License-Identifier: Apache-2.0
"""What is known of the clocks: the file of a comparison, or the user's word."""

from pathlib import Path

import pytest

from seed_core import clocks as module
from seed_core.clocks import ONE, SIMULATED, Clocks, read_clocks, save_clocks
from seed_core.config import ConfigError


def test_nothing_known_is_a_problem_that_says_what_to_run() -> None:
    assert "./seed identify --live" in read_clocks("").problem
    assert "clocks:=one" in read_clocks("").problem


def test_a_comparison_that_cannot_be_written_leaves_the_former_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "clocks.yaml"
    save_clocks(file, 0.01, 0.001, "2026-11-22")

    def full(path: Path, text: str, encoding: str) -> None:
        path.write_bytes(text.encode(encoding)[:20])
        raise OSError("No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space"):
        save_clocks(file, 0.02, 0.001, "2026-11-23")
    assert read_clocks(str(file)).offset == 0.01


@pytest.mark.parametrize("word", [ONE, SIMULATED])
def test_one_clock_needs_no_comparison(word: str) -> None:
    known = read_clocks(word)
    assert (known.offset, known.problem) == (0.0, "")


def test_a_comparison_made_here_gives_its_offset(tmp_path: Path) -> None:
    file = tmp_path / "clocks.yaml"
    save_clocks(file, -0.0123, 0.0004, "2026-11-22T10:00:00+00:00", "arm 1", "bubbles 3 and 4")
    assert list(tmp_path.iterdir()) == [file]
    known = read_clocks(str(file))
    assert (known.offset, known.deviation, known.problem) == (-0.0123, 0.0004, "")
    assert "-12.3 +- 0.4 ms" in known.remark
    assert "before this computer was started" not in known.remark


def test_another_computers_comparison_is_refused_and_one_before_a_restart_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "clocks.yaml"
    save_clocks(file, 0.01, 0.001, "2026-11-22")
    monkeypatch.setattr(module, "boot", lambda: "another")
    assert "before this computer was started" in read_clocks(str(file)).remark
    file.write_text(file.read_text().replace(f"host: {module.socket.gethostname()}", "host: elsewhere"))
    assert "'elsewhere'" in read_clocks(str(file)).problem


def test_an_offset_that_the_estimator_does_not_take_off_is_a_problem() -> None:
    known = Clocks(offset=0.030, deviation=0.0005)
    assert not known.not_taken_off(0.0305)
    assert "takes 0.0 ms off the images' stamps, where the controller's clocks say 30.0 ms" in known.not_taken_off(0.0)
    assert known.not_taken_off(-0.030)
    assert known.not_taken_off(float("nan"))
    assert not Clocks(offset=0.001).not_taken_off(0.0)  # of no account
    assert not Clocks(offset=0.030, deviation=0.004).not_taken_off(0.023)  # both may be right
    assert Clocks(offset=0.030, deviation=0.004).not_taken_off(0.0215)  # beyond twice the deviation


@pytest.mark.parametrize("words", ["yes", "missing/clocks.yaml"])
def test_words_that_say_nothing_are_refused(words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_clocks(words)


def test_values_out_of_bounds_are_named(tmp_path: Path) -> None:
    file = tmp_path / "clocks.yaml"
    save_clocks(file, 0.01, 0.001, "2026-11-22")
    file.write_text(file.read_text().replace("offset: 0.01", "offset: 10.0"))
    with pytest.raises(ConfigError, match="offset"):
        read_clocks(str(file))
