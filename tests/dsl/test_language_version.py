"""A file names its version of the language; of a file of another version only that is reported."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import check_file, check_text, load_text

ROBOT = """
robot r {
  sensor bumper : bool  from RServer.bumper
  actuator lamp { level : number } to DServer.Lamp idle hold
}
"""


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("language 3", "a newer colony reads it"),
        pytest.param(f"language {'9' * 5_000}", "a newer colony reads it", id="long"),
        ("language 1.0", "write `language 1`"),
        ("language 0", "write `language 1`"),
        ("language 1 mm", "write `language 1`"),
    ],
)
def test_other_versions_are_refused_and_nothing_else_is_said(line: str, hint: str) -> None:
    (found,) = check_text(f"{line}\nlet a = held(nothing, 1 s)\nlet b = = 3\n", "x.colony").diagnostics
    version = line.removeprefix("language ")
    assert (found.code, found.hint, found.span.text) == ("E008", hint, line)
    assert found.message == f"found version {version} of the language; this is version 1"


@pytest.mark.parametrize("rest", ["behavior b {", "language 3", ";"])
def test_error_right_after_another_version_is_not_reported(rest: str) -> None:
    (found,) = check_text(f"language 2\n{rest}\n{ROBOT}").diagnostics
    assert (found.code, found.span.text) == ("E008", "language 2")


def test_an_import_of_another_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / "other.colony").write_text(f"language 3\n{ROBOT}")
    (tmp_path / "main.colony").write_text('language 1\nimport "other.colony"\n')
    (found,) = check_file(tmp_path / "main.colony").diagnostics
    assert (found.code, Path(found.span.source.name).name) == ("E008", "other.colony")


def test_a_text_without_the_line_is_of_this_version() -> None:
    program = load_text(f"let a = recently(bumper, 1 s){ROBOT}")
    assert program == load_text(f"language 1\nlet a = recently(bumper, 1 s){ROBOT}")


@pytest.mark.parametrize(
    "text", ["let a = 3\nlanguage 1\n", "language 1\nlanguage 1\n", "module m { when true\nlanguage 1 }"]
)
def test_a_line_that_is_not_first_has_a_hint(text: str) -> None:
    first = check_text(text).diagnostics[0]
    assert (first.code, first.hint) == ("E005", "a file has this line once, before its first declaration")


def test_errors_after_the_line_are_where_they_are() -> None:
    found = check_text(f"language 1\nlet a = = 3\n{ROBOT}").diagnostics
    assert [(d.code, d.span.source.position(d.span.start)) for d in found] == [("E005", (2, 9))]
