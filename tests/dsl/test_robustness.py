"""Whatever the text or the file: a diagnostic with a place, soon, and nothing raised."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from colony.dsl.files import MAX_BYTES
from colony.dsl.load import Checked, check_file, check_text
from colony.text.diagnostics import headline, render
from tests.dsl.texts import MODULES, ROBOT, findings, messages

MANY = 5_000
LARGE = 500_000
"""Characters of the large texts here; ten times as many take ten times as long, a few seconds."""


def codes(checked: Checked) -> list[str]:
    """The codes found, each diagnostic rendered once: that must not fail either."""
    for d in checked.diagnostics:
        assert ": error[" in render(d) or ": warning[" in render(d)
    return [d.code for d in checked.diagnostics]


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("let a = " + "(" * MANY + "1" + ")" * MANY, "E004"),
        ("let a = " + "(" * MANY, "E004"),
        ("let a = sonar" + "[" * MANY, "E004"),
        ("{" * MANY, "E004"),
        ("let a = " + "not " * MANY + "bumper", "E004"),
        ("let a = " + "-" * MANY + "1", "E004"),
        ("let a = " + " + ".join("1" * MANY), "E004"),
        ("let a = " + " implies ".join(["bumper"] * MANY), "E004"),
        ("let a = " + "if bumper then 1 else " * MANY + "1", "E004"),
        ("let a = sonar" + "[1]" * MANY, "E004"),
        ("let a = sonar" + ".x" * MANY, "E108"),
        ("let a = " + "f(" * 90 + ")" * 90, "E107"),
        ("network { x = " + " suppresses ".join(["m"] * MANY) + " }", "E101"),
        ("let a = sum(k for k in 0 .. 999999999)", "E211"),
        ("let a = sum(k for k in 0 .. 1e300)", "E214"),
        ("let a = sonar[0 .. 1e300]", "E214"),
        ("let a = window(sonar, 0, 1e300)", "E214"),
        ("let a = sonar[1e300]", "E205"),
        ("let a = sonar[1e308 * 10]", "E205"),
        ("let a = sonar[0 / 0]", "E205"),
        ("let a = recently(bumper, 1e300 s)", "E213"),
        ("let a = 1 m^99999999999", "E011"),
        ("let a = 1 " + "*".join(["m^9"] * 1000), "E011"),
        ("let a = 1 " + "*".join(["mm"] * 100_000), "E011"),
        ("state s : " + "*".join(["mm"] * 100_000) + " = 0", "E011"),
        ("state s : mm^99999999999 = 0", "E011"),
        ('test "t" { from 0 s to 1e9 s every 1e-9 s }', "E604"),
        ("let a\0 = 3", "E005"),
        ("let a = \ud800", "E005"),
        ("let a = 3 \ufeff", "E005"),
        ("let\u00a0a = 3", "E005"),
        ("robot r { sensor a[999999999999] : mm from A.b }", "E214"),
        ("robot r { sensor a[1e308] : mm from A.b }", "E214"),
    ],
    ids=lambda v: v[:30] if isinstance(v, str) else None,
)
def test_extreme_expressions(text: str, code: str) -> None:
    robot = "" if text.startswith(("robot", "{")) else ROBOT
    assert code in codes(check_text(text + "\n" + robot))


@pytest.mark.parametrize(
    "unit",
    [" ", "\n", "a", "1", "(", "}", "let ", '"', "#", "x = ", "\0", "é", "1 ", "-> ", "..", "let a = 1\n"],
)
def test_large_texts_of_one_thing(unit: str) -> None:
    found = codes(check_text(unit * (LARGE // len(unit) // (100 if unit == "let a = 1\n" else 1))))
    assert found


def test_a_large_name_number_unit_and_comment() -> None:
    assert codes(check_text("let " + "a" * LARGE + " = nobody" + ROBOT)) == ["E101"]
    assert codes(check_text("let a = " + "b" * LARGE + ROBOT)) == ["E101"]
    assert codes(check_text("let a = " + "1" * LARGE + ROBOT)) == ["E010"]
    assert codes(check_text("let a = 1 " + "mm*" * (LARGE // 3) + "mm" + ROBOT)) == ["E011"]
    assert codes(check_text("# " + "a" * LARGE + ROBOT)) == []


def test_garbage() -> None:
    garbage = "".join(chr(33 + (i * 7919) % 90) for i in range(1000)) * (LARGE // 1000)
    assert codes(check_text(garbage))


@pytest.mark.long
def test_programs_of_thousands_of_parts() -> None:
    chain = f"{MODULES}module m0 = avoid\n" + "".join(f"module m{i + 1} = m{i}\n" for i in range(2000))
    assert findings(chain) == []
    wires = "".join(f"w{i} = w{i + 1} suppresses cruise " for i in range(5000)) + "w5000 = cruise"
    assert findings(f"{MODULES}\nnetwork {{ {wires} }}") == []
    cycle = "".join(f"w{i} = w{(i + 1) % 5000} suppresses cruise " for i in range(5000))
    [found] = findings(f"{MODULES}\nnetwork {{ {cycle} }}")
    assert found.endswith("E502")


@pytest.mark.thorough
def test_thousands_of_errors() -> None:
    assert len(findings("".join(f"let a{i} = nobody{i}\n" for i in range(2000)))) == 2000
    assert len(findings("let a = 3\n" * 2000)) == 1999
    assert len(findings("let a = = 3\n" * 2000)) == 21


def test_an_empty_file_has_no_robot() -> None:
    for text in ("", "\n", "# only a comment"):
        [found] = check_text(text).diagnostics
        assert headline(found) == "<text>:1:1: error[E301]: the program has no robot"


# --- files ---------------------------------------------------------------------------------------


def in_file(folder: Path, data: bytes) -> Checked:
    path = folder / "x.colony"
    path.write_bytes(data)
    return check_file(path)


def test_what_is_no_regular_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
    strange: list[Path | str] = [tmp_path, "/dev/zero", "/dev/null", "nothing.colony", "", "a\0b", "a" * 5000]
    strange += [tmp_path / name for name in ("fifo", "loop", "dangling", "fifo/x")]
    for path in strange:
        assert codes(check_file(path)) == ["E001"], path


def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    path = tmp_path / "secret.colony"
    path.write_text(ROBOT)
    path.chmod(0)
    if os.access(path, os.R_OK):
        pytest.skip("this user may read everything")
    assert codes(check_file(path)) == ["E001"]


def test_a_file_that_is_too_large(tmp_path: Path) -> None:
    path = tmp_path / "large.colony"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    assert codes(check_file(path)) == ["E003"]


@pytest.mark.parametrize(
    ("data", "place"),
    [
        (b"let a = \xff", "1:9"),
        (b"let a = 3\nlet \xc3\xa9 = \xc3", "2:9"),
        (b"\xef\xbb\xbflet a = \xff", "1:9"),
        (b"let a\0 = 3", "1:6"),
        (b"\xff\xfel\0e\0t\0", "1:1"),
        (b"\xed\xa0\x80", "1:1"),
    ],
)
def test_bytes_that_are_no_text(data: bytes, place: str, tmp_path: Path) -> None:
    [found] = in_file(tmp_path, data).diagnostics
    assert found.code == "E002"
    assert ":".join(map(str, found.span.source.position(found.span.start))) == place


@pytest.mark.parametrize(
    "robot", [ROBOT, ROBOT.replace("\n", "\r\n"), ROBOT.replace("\n", "\r"), "\ufeff" + ROBOT]
)
def test_marks_and_ends_of_lines(robot: str, tmp_path: Path) -> None:
    assert codes(in_file(tmp_path, robot.encode())) == []


def test_the_source_line_is_shown_without_control_characters() -> None:
    shown = messages("let a\x1b[31m = \t\x07nobody")
    assert "\x1b" not in shown
    assert "\x07" not in shown
