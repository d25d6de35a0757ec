# SPDX-License-Identifier: Apache-2.0
"""Files are written whole or not at all."""

from pathlib import Path

import numpy as np
import pytest

from seed_core.program.command_line import command
from seed_core.program.files import write_text, written_whole
from seed_core.program.npz import read_npz, write_npz


def test_a_file_is_the_old_one_until_the_new_one_is_complete(tmp_path: Path) -> None:
    file = tmp_path / "a.b.txt"
    write_text(file, "old")
    with written_whole(file) as part:
        part.write_text("new")
        assert file.read_text() == "old"
        assert part.name == "a.b.txt.part"
    assert file.read_text() == "new"
    assert list(tmp_path.iterdir()) == [file]


def test_an_error_leaves_the_old_file_and_no_part(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    write_text(file, "old")
    with pytest.raises(UnicodeEncodeError):
        write_text(file, "half of it, and then \ud800")  # which no UTF-8 has
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_arrays_read_back_under_any_name(tmp_path: Path) -> None:
    file = tmp_path / "a.of_today"
    write_npz(file, {"x": np.arange(3)})
    np.testing.assert_array_equal(read_npz(file, "no arrays")["x"], np.arange(3))
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("name", ["", "/", "{folder}", "/dev/null"])
def test_a_folder_or_a_device_is_no_file_to_write(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileExistsError, match="is a folder or a device: name a file"):
        write_text(name.format(folder=tmp_path), "text")
    assert not list(tmp_path.iterdir())


def test_what_a_link_leads_to_is_written(tmp_path: Path) -> None:
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_text("old")
    link.symlink_to(file)
    write_text(link, "new")
    assert link.is_symlink()
    assert file.read_text() == "new"


def test_a_full_disk_is_told_with_the_file_that_could_not_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "result.json"
    file.write_text("old")
    (tmp_path / "result.json.part").symlink_to("/dev/full")

    def main(_: list[str]) -> None:
        write_text(file, "new")

    assert command("seed tool")(main)([]) == 1
    assert capsys.readouterr().err == f"seed tool: {file}: No space left on device\n"
    assert [f.name for f in tmp_path.iterdir()] == ["result.json"]
    assert file.read_text() == "old"
