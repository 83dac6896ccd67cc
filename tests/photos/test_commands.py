"""The commands of photos: exit codes and what is said."""

from __future__ import annotations

import pytest

from part2gs_robotics.cli import main


def test_marker_writes_the_sheet_and_says_how_to_print_it(tmp_path, capsys):
    assert main(["marker", "-o", str(tmp_path / "a.pdf")]) == 0
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
    assert "100 %" in capsys.readouterr().out


def test_marker_writes_a_board_too(tmp_path):
    assert main(["marker", "--charuco", "-o", str(tmp_path / "board.pdf"), "--quiet"]) == 0
    assert main(["marker", "-o", str(tmp_path / "sheet.pdf"), "--quiet"]) == 0
    pages = [(tmp_path / name).read_bytes() for name in ("board.pdf", "sheet.pdf")]
    assert pages[0].startswith(b"%PDF")
    assert pages[0] != pages[1]


@pytest.mark.parametrize(("words", "text"), [
    (["marker", "-o", "a.txt"], "ends in .pdf"),
    (["scene", "nothing"], "got 1 paths"),
    (["scene", "a", "b", "--side", "9"], "Expected a whole number from 400 to 4096"),
    (["scene", "a", "b", "--views", "9"], "does not use --views"),
    (["inspect", "nothing"], "Expected a scene folder"),
])  # fmt: skip
def test_bad_words_end_with_code_2_and_write_nothing(tmp_path, monkeypatch, capsys, words, text):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert text in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
