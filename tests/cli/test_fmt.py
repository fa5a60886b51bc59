from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.conftest import Colony

UNTIDY = "param a=1\nmodule go{when true do drive(v=a)}\n"
TIDY = "param a = 1\nmodule go { when true do drive(v = a) }\n"
BROKEN = "let a =\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, with an untidy file, a tidy one, and hidden ones."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    (tmp_path / ".hidden").mkdir()
    (tmp_path / "sub" / "untidy.colony").write_text(UNTIDY)
    (tmp_path / "tidy.colony").write_text(TIDY)
    (tmp_path / ".hidden" / "other.colony").write_text(UNTIDY)
    (tmp_path / "notes.txt").write_text(UNTIDY)
    return tmp_path


def test_a_folder_is_formatted_without_what_is_hidden(colony: Colony, folder: Path) -> None:
    (folder / "sub" / "untidy.colony").chmod(0o640)
    assert colony("fmt") == (0, "sub/untidy.colony: formatted\n", "")
    assert (folder / "sub" / "untidy.colony").read_text() == TIDY
    assert (folder / "sub" / "untidy.colony").stat().st_mode & 0o777 == 0o640
    assert (folder / ".hidden" / "other.colony").read_text() == UNTIDY
    assert colony("fmt", ".") == (0, "", "")


def test_check_names_the_files_and_writes_nothing(colony: Colony, folder: Path) -> None:
    assert colony("fmt", "--check", "sub", "tidy.colony") == (1, "sub/untidy.colony: not formatted\n", "")
    assert (folder / "sub" / "untidy.colony").read_text() == UNTIDY
    assert colony("fmt", "--check", "tidy.colony") == (0, "", "")


def test_diff_shows_what_would_change(colony: Colony, folder: Path) -> None:
    code, out, _ = colony("fmt", "--diff", "sub/untidy.colony")
    assert code == 1
    assert out.startswith("--- sub/untidy.colony\n+++ sub/untidy.colony (formatted)\n")
    assert "-param a=1\n" in out
    assert "+param a = 1\n" in out
    assert (folder / "sub" / "untidy.colony").read_text() == UNTIDY


def test_standard_input_goes_to_standard_output(colony: Colony, folder: Path) -> None:
    assert colony("fmt", "-", stdin=UNTIDY) == (0, TIDY, "")
    assert colony("fmt", "--check", "-", stdin=UNTIDY) == (1, "<stdin>: not formatted\n", "")
    assert colony("fmt", "-", stdin=TIDY) == (0, TIDY, "")
    assert "<stdin>:1:7: error[E005]" in colony.refusal("fmt", "-", stdin=BROKEN)


def test_a_file_with_errors_stays_and_the_others_are_formatted(colony: Colony, folder: Path) -> None:
    (folder / "broken.colony").write_text(BROKEN)
    code, out, err = colony("fmt", ".")
    assert (code, out) == (2, "sub/untidy.colony: formatted\n")
    assert "broken.colony:1:7: error[E005]: found the end of the file, expected an expression" in err
    assert (folder / "broken.colony").read_text() == BROKEN
    assert "cannot read `none.colony`" in colony.one_line("fmt", "none.colony")


def test_a_file_keeps_the_ends_of_its_lines(colony: Colony, folder: Path) -> None:
    file = folder / "tidy.colony"
    file.write_bytes(UNTIDY.replace("\n", "\r\n").encode())
    assert colony("fmt", "tidy.colony") == (0, "tidy.colony: formatted\n", "")
    assert file.read_bytes() == TIDY.replace("\n", "\r\n").encode()
    assert colony("fmt", "--check", "tidy.colony").code == 0


def test_a_difference_is_one_that_patch_reads(colony: Colony, folder: Path) -> None:
    (folder / "tidy.colony").write_text("# a\x0cb\u2028c\nparam a=1", encoding="utf-8")
    _, out, _ = colony("fmt", "--diff", "tidy.colony")
    assert out.split("\n")[3:] == [
        " # a\x0cb\u2028c",
        "-param a=1",
        "\\ No newline at end of file",
        "+param a = 1",
        "",
    ]
