"""Files of version 1 become files of version 2 that mean the same, and what differs is asked of a person."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colony.dsl import ast
from colony.dsl.files import load_tree
from colony.dsl.load import check_file, check_text, load_file, load_text
from colony.dsl.missing import Missing
from colony.dsl.parse import parse
from colony.dsl.upgrade import apply_edits, is_version_1, upgrade_edits, upgrade_tree
from colony.dsl.upgrade_decisions import decisions_about
from colony.dsl.upgrade_files import upgrade_files
from colony.ir import expression as ir
from colony.ir.program import Program
from colony.ir.types import BOOL
from colony.runtime.recordings.replay import Rows
from colony.text.diagnostics import Diagnostic
from colony.text.source import Source
from colony.verify.difference import Same, difference
from colony.verify.difference.content import contents
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.strategies import traces
from tests.drawn.strategies import programs, texts
from tests.dsl.version1_frames import FOLDER, frames
from tests.paths import BEHAVIORS as SHIPPED
from tests.paths import THESIS_NAVIGATOR

BEHAVIORS = sorted(FOLDER.glob("*.colony"))
CURRENT = {path.stem: path for path in (*SHIPPED, THESIS_NAVIGATOR)}


def upgraded(text: str) -> str:
    """The text as version 2; it has no syntax errors."""
    parsed = parse(Source("x.colony", text))
    assert parsed.diagnostics == ()
    return apply_edits(text, upgrade_edits(text, parsed.file))


def named(names: list[Path]) -> dict[str, str | None]:
    return {Path(one.name).name: one.new for one in upgrade_files([str(name) for name in names])}


def decided_by_hand(text: str) -> str:
    """The text with what a person has to decide: indices of RoME's sonars wrap, so they are a ring."""
    return text.replace("sensor   sonar[24] : mm  ", "sensor   sonar[24] : mm bearing -180 deg")


MENDS = {
    """
module back_off {
  when recently(front_bumper, 1.5 s)
  do   drive(velocity = -150 mm/s, turn = if room_left > room_right then 30 deg/s else -30 deg/s)
}
""": """
module back_off {
  when recently(front_bumper, 1.5 s)
  do   drive(velocity = -150 mm/s,
             turn = if captured(room_left > room_right, recently(front_bumper, 1.5 s))
                    then 30 deg/s else -30 deg/s)
}
let sticks = sustained(front_bumper, 5 s)
module stuck { when sticks }
""",
    "  wandering = docked inhibits blind inhibits roam": (
        "  wandering = docked inhibits blind inhibits stuck inhibits roam"
    ),
    "  let   near = min(sonar[10..14]) < clearance or fastest_ahead < 300 mm/s": """
  state relents : bool = false
  let   close = if relents then min(700 mm, clearance) else clearance
  let   near = min(sonar[10..14]) < close or fastest_ahead < (if relents then 150 mm/s else 300 mm/s)
  next  relents = recently(sustained(recently(near, 2 s), 10 s), 20 s)""",
    "let fastest_ahead  =": """
let unheard = value_or(any(infrared[10..14] and sonar[10..14] > 1 m), false)
let fastest_heard =""",
    "let fastest_behind =": """
let fastest_ahead = if unheard then min(fastest_heard, 250 mm/s) else fastest_heard
let fastest_behind =""",
    "module arm   {": """
let sticks = sustained(front_bumper, 5 s)
module stuck { when sticks }
module arm   {""",
    "arm inhibits (ballistic": "arm inhibits stuck inhibits (ballistic",
    "module arrived { when e_goal }": """
let sticks = sustained(front_bumper or rear_bumper, 5 s)
module stuck { when sticks }
module arrived { when e_goal }""",
    "blind inhibits (arrived inhibits checked)": (
        "blind inhibits (arrived inhibits (stuck inhibits checked))"
    ),
    "arrived inhibits moving": "arrived inhibits (hallway.stuck inhibits moving)",
}
"""What behaviors do otherwise today: parts of their files as upgraded, and what has taken their place."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All behaviors as they stood in version 1, upgraded."""
    path = tmp_path_factory.mktemp("upgraded")
    for name, text in named(BEHAVIORS).items():
        assert text is not None
        (path / name).write_text(decided_by_hand(text))
    return path


@pytest.fixture(scope="module")
def mended(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The upgraded behaviors, with what was mended since."""
    path = tmp_path_factory.mktemp("mended")
    texts = {file.name: file.read_text() for file in folder.iterdir()}
    for before, after in MENDS.items():
        assert any(before in text for text in texts.values())
        texts = {name: text.replace(before, after) for name, text in texts.items()}
    for name, text in texts.items():
        (path / name).write_text(text)
    return path


# --- behaviors as they stood in version 1 ------------------------------------------------------------


def test_they_are_those_of_version_1() -> None:
    assert len(BEHAVIORS) == 12
    texts = "".join(path.read_text() for path in BEHAVIORS)
    assert texts.count("held(") == 14
    assert "language 2" not in texts


@pytest.mark.parametrize("path", BEHAVIORS, ids=lambda path: path.stem)
def test_a_behavior_checks_after_its_upgrade(path: Path, folder: Path) -> None:
    checked = check_file(folder / path.name)
    assert not [d for d in checked.diagnostics if d.severity == "error"]
    assert all(file.tree.language == ast.LanguageDecl(version="2") for file in checked.tree.files)


@pytest.mark.parametrize("path", BEHAVIORS, ids=lambda path: path.stem)
def test_a_behavior_is_what_it_has_become(path: Path, mended: Path) -> None:
    """It has other text, and decides the same bit for bit: what it sends, and its values of the same name."""
    program, current = load_file(mended / path.name), load_file(CURRENT[path.stem])
    if any(wire.actuator for wire in program.wires):
        result = difference(program, current)
        assert isinstance(result, Same)
        assert result.by_content
    old, new = contents(program, current)
    names = {derived.name: derived for derived in current.derived}
    both = [(derived, names[derived.name]) for derived in program.derived if derived.name in names]
    assert len(both) >= 0.7 * len(program.derived)
    assert all(old.derived(one) == new.derived(other) for one, other in both)


@pytest.mark.parametrize("path", BEHAVIORS, ids=lambda path: path.stem)
def test_all_but_the_changed_words_stays(path: Path, folder: Path) -> None:
    old, new = decided_by_hand(path.read_text()).splitlines(), (folder / path.name).read_text().splitlines()
    at = new.index("language 2")
    assert new[at - 2].startswith("#")
    assert (new[at - 1], new[at + 1]) == ("", "")
    assert new[: at - 1] + new[at + 1 :] == [line.replace("held(", "recently(") for line in old]


@pytest.mark.parametrize("path", BEHAVIORS, ids=lambda path: path.stem)
def test_a_second_upgrade_changes_nothing(path: Path, folder: Path) -> None:
    (again,) = upgrade_files([str(folder / path.name)])
    assert (again.new, again.diagnostics) == ((folder / path.name).read_text(), ())


def decided(program: Program, name: str) -> list[dict[str, object]]:
    """What the interpreter decides on the frames of a behavior, in declared units."""
    interpreter, out = Interpreter(program), []
    fields = {a.name: [f.name for f in a.fields] for a in program.robot.actuators}
    lines = (f"{line}\n".encode() for line in frames(program, name))
    for row in Rows(lines, name, program):
        decisions = interpreter.step(row.frame).decisions
        out.append(
            {
                d.actuator: None
                if d.values is None
                else {"by": d.by, **dict(zip(fields[d.actuator], d.values, strict=True))}
                for d in decisions
            }
        )
    return out


@pytest.mark.parametrize("name", [path.stem for path in sorted(FOLDER.glob("*.decisions"))])
def test_it_decides_as_version_1_did(name: str, folder: Path) -> None:
    program = load_file(folder / f"{name}.colony")
    expected = [json.loads(line) for line in (FOLDER / f"{name}.decisions").read_text().splitlines()]
    found = decided(program, name)
    assert len(found) == len(expected) == 120
    winners = set()
    for one, other in zip(found, expected, strict=True):
        for actuator, decision in one.items():
            right = other.get(actuator)
            assert (decision is None) is (right is None), other
            if isinstance(decision, dict) and right is not None:
                winners.add(decision["by"])
                assert decision["by"] == right["by"], other
                rest = {key: value for key, value in decision.items() if key != "by"}
                # sines and cosines are nearer to the true value than they were
                assert rest == pytest.approx({key: right[key] for key in rest}, rel=1e-9, abs=1e-9), other
    assert len(winners) >= 4


# --- the line ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("", "language 2\n"),
        ("\n", "language 2\n\n"),
        ("let a = 1", "language 2\n\nlet a = 1"),
        ("let a = 1\r\nlet b = 2", "language 2\r\n\r\nlet a = 1\r\nlet b = 2"),
        ("let a = 1\rlet b = 2\r", "language 2\r\rlet a = 1\rlet b = 2\r"),
        ("# c", "language 2\n\n# c"),
        ("# of a\nlet a = 1\n", "language 2\n\n# of a\nlet a = 1\n"),
        ("# of a\r\nlet a = 1\r\n", "language 2\r\n\r\n# of a\r\nlet a = 1\r\n"),
        ("# head\n# er\n\nlet a = 1\n", "# head\n# er\n\nlanguage 2\n\nlet a = 1\n"),
        ("# head\r\n\r\nlet a = 1", "# head\r\n\r\nlanguage 2\r\n\r\nlet a = 1"),
        ("  # head\n \t\nlet a = 1", "  # head\n\nlanguage 2\n \t\nlet a = 1"),
        ("# head\n\n# of a\nlet a = 1", "# head\n\nlanguage 2\n\n# of a\nlet a = 1"),
        ("\n# head\n\nlet a = 1", "language 2\n\n# head\n\nlet a = 1"),
        ("# c\nlanguage 1 # d\nlet a = 1", "# c\nlanguage 2 # d\nlet a = 1"),
        ("language\n  1\nlet a = 1", "language 2\nlet a = 1"),
    ],
)
def test_where_the_line_goes(old: str, new: str) -> None:
    assert upgraded(old) == new
    file = parse(Source("x", new)).file
    assert file.language == ast.LanguageDecl(version="2")
    assert not is_version_1(file)


# --- `held` ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("let a = held(b, 1 s)", "let a = recently(b, 1 s)"),
        ("let a = held # held(\n (b, 1 s)", "let a = recently # held(\n (b, 1 s)"),
        ("let a = not held(held(b, 1 s), 2 s)", "let a = not recently(recently(b, 1 s), 2 s)"),
        ("let a = any(held(b[k], 1 s) for k in 0..3)", "let a = any(recently(b[k], 1 s) for k in 0..3)"),
        ("limit d.v <= 1 when held(b, 1 s)", "limit d.v <= 1 when recently(b, 1 s)"),
        (
            "machine m { start p p -> q when held(b, 1 s) }",
            "machine m { start p p -> q when recently(b, 1 s) }",
        ),
        (
            'test "held(b)" { at 0 s expect held(b, 1 s) }',
            'test "held(b)" { at 0 s expect recently(b, 1 s) }',
        ),
        ("let held = 1 let a = held + m.held", "let held = 1 let a = held + m.held"),
        ("module a = held(p = 1)", "module a = held(p = 1)"),
        ("module m { when true do held(p = 1) }", "module m { when true do held(p = 1) }"),
    ],
)
def test_only_calls_are_renamed(old: str, new: str) -> None:
    assert upgraded(old) == f"language 2\n\n{new}"


# --- decisions ---------------------------------------------------------------------------------------

ROBOT = """
robot r {
  sensor near   : mm   range 0 .. 5000  from PServer.near
  sensor top    : mm                    from PServer.top
  sensor known  : mm   default 0        from PServer.known
  sensor bumper : bool                  from RServer.bumper
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s }
           to RServer.drive idle drive(velocity = 0, turn = 0)
  actuator lift { height : mm range 0 .. 2000 } to XServer.lift idle lift(height = 0.3 m)
  actuator lamp { level : number } to DServer.Lamp idle hold
}
"""


def asked(text: str, robot: str = ROBOT) -> list[Diagnostic]:
    tree = load_tree(Path("x.colony"), "x.colony", text + robot)
    found = upgrade_tree(tree)
    assert found.program is not None, found.diagnostics
    return list(decisions_about(found.program, found.diagnostics, found.files[-1].new.source))


def places(text: str, robot: str = ROBOT) -> list[tuple[str, str]]:
    """The code and text of each finding."""
    return [(d.code, d.span.text) for d in asked(text, robot)]


@pytest.mark.parametrize(
    ("limits", "found"),
    [
        ("limit drive.velocity <= near / 1 s limit drive.velocity <= 100 mm/s", 0),
        ("limit drive.velocity <= near / 1 s limit drive.turn >= 10 deg/s", 0),
        ("limit drive.velocity >= -100 mm/s limit drive.velocity <= 100 mm/s", 0),
        ("limit drive.velocity >= 100 mm/s limit drive.velocity <= -100 mm/s", 1),
        ("limit drive.velocity <= near / 1 s limit drive.velocity >= 100 mm/s when bumper", 1),
        ("limit drive.velocity <= -601 mm/s", 1),
        ("limit drive.velocity >= 601 mm/s when bumper", 1),
        ("limit drive.velocity >= -601 mm/s limit drive.velocity <= 601 mm/s", 0),
        ("limit drive.velocity >= near / 1 s limit drive.velocity <= top / 1 s limit drive.velocity <= 0", 2),
    ],
)
def test_limits_that_can_contradict(limits: str, found: int) -> None:
    assert [code for code, _ in places(limits)] == ["U001"] * found


def test_the_limit_that_version_1_used_is_named_with_those_before_it() -> None:
    (one,) = asked("limit drive.velocity <= near / 1 s\nlimit drive.velocity >= 100 mm/s when bumper")
    assert one.span.text == "limit drive.velocity >= 100 mm/s when bumper"
    assert [label.span.text for label in one.labels] == ["limit drive.velocity <= near / 1 s"]


def test_a_limit_that_loosens_that_of_an_import(tmp_path: Path) -> None:
    (tmp_path / "base.colony").write_text(
        ROBOT + "limit drive.velocity <= held_back\nlet held_back = near / 1 s\n"
    )
    (tmp_path / "main.colony").write_text('import "base.colony"\nlimit drive.velocity >= 200 mm/s\n')
    main, base = upgrade_files([str(tmp_path / "main.colony"), str(tmp_path / "base.colony")])
    (one,) = main.diagnostics
    assert (one.code, one.span.text, base.diagnostics) == ("U001", "limit drive.velocity >= 200 mm/s", ())
    assert one.span.source.position(one.span.start) == (4, 1)
    assert one.labels[0].span.source.name.endswith("base.colony")


def test_limits_of_two_imports_meet_in_the_file_that_imports_both(tmp_path: Path) -> None:
    (tmp_path / "robot.colony").write_text(ROBOT)
    for name, limit in (("a", "<= near / 1 s"), ("b", ">= 200 mm/s")):
        (tmp_path / f"{name}.colony").write_text(f'import "robot.colony"\nlimit drive.velocity {limit}\n')
    (tmp_path / "main.colony").write_text('import "a.colony"\nimport "b.colony"\n')
    found = {
        Path(u.name).stem: u.diagnostics for u in upgrade_files([str(p) for p in tmp_path.glob("*.colony")])
    }
    assert [len(found[name]) for name in ("robot", "a", "b", "main")] == [0, 0, 0, 1]


@pytest.mark.parametrize(
    ("limit", "now"),
    [
        ("limit drive.velocity <= near / 1 s", None),
        ("limit lift.height <= top", "the idle command's 300 mm"),
        ("limit lift.height <= known", None),
        ("limit lift.height <= 1 m", None),
        ("limit lift.height <= 1 m when near < 1 m", None),
        ("limit lift.height <= value_or(top, 1 m)", None),
        ("limit lift.height <= value_or(known, top)", "`top` is missing"),
        ("let high = top - near limit lift.height <= high", "`near` or `top` is missing"),
        ("limit lift.height <= known * 2 / known * 1 mm", "where it is not finite"),
        ("limit lamp.level <= near / 1 mm", "nothing is sent"),
    ],
)
def test_bounds_that_can_be_missing(limit: str, now: str | None) -> None:
    found = [d for d in asked(limit) if d.code == "U002"]
    assert len(found) == (now is not None)
    assert all(now is not None and now in d.message for d in found)


@pytest.mark.parametrize(
    ("transitions", "blind"),
    [
        ("a -> b when bumper a -> c when true", ["a -> b when bumper"]),
        ("a -> b when bumper b -> c when true", []),
        ("a -> b when bumper any -> c when true", ["a -> b when bumper"]),
        ("any -> b when bumper b -> c when true", []),
        ("any -> c when bumper b -> a when true", ["any -> c when bumper"]),
        ("a -> b when true a -> c when bumper", []),
        ("a -> b when fresh(bumper) a -> c when true", []),
        ("a -> b when value_or(bumper, false) a -> c when true", []),
        ("a -> b when bumper a -> c when bumper and near < 1 m", []),
        ("a -> b when near < 1 m a -> c when bumper", ["a -> b when near < 1 m"]),
        ("a -> b when known > 1 m a -> c when bumper", []),
        ("a -> b when elapsed(m == m.a) > 1 s a -> c when true", []),
    ],
)
def test_transitions_that_hold_others_back(transitions: str, blind: list[str]) -> None:
    assert places(f"machine m {{ start a {transitions} }}") == [("U003", text) for text in blind]


@pytest.mark.parametrize(
    ("contract", "asks"),
    [
        ("bumper implies drive.velocity <= 0", True),
        ("fresh(bumper) implies (bumper implies drive.velocity <= 0)", False),
        ("fresh(bumper) and bumper implies drive.velocity <= 0", False),
        ("not fresh(bumper) or not bumper or drive.velocity <= 0", False),
        ("value_or(bumper, false) implies drive.velocity <= 0", False),
        ("value_or(bumper, near < 1 m) implies drive.velocity <= 0", True),
        ("fresh(near) implies bumper", True),
        ("if fresh(near) then near < 6 m else drive.velocity == 0", False),
        ("if near < 1 m then true else true", True),
        ("known < 1 m", False),
        ("drive.velocity <= 600 mm/s", False),
        ("drive by stop implies near < 3 m", False),
        ("drive by stop implies stop.slow", False),
        ("stop is active implies near < 3 m", False),
        ("stop.slow or true", False),
        ("stop.slow", True),
        ("drive by stop implies bumper", True),
        ("fresh(close) implies close", False),
        ("close", True),
        ("lamp.level < 3", True),
        ("lamp is commanded implies lamp.level < 3", True),
        ("recently(bumper, 1 s) implies drive.velocity <= 0", True),
        ("all(near * k < 1 m for k in 0..3 if fresh(near))", False),
        ("any(near * k < 1 m and fresh(near) for k in 0..3) or not fresh(near)", False),
        ("any(bumper, not fresh(bumper))", False),
        ("fresh(near) or fresh(bumper) or top > 0", True),
    ],
)
def test_contracts_that_can_be_unknown(contract: str, asks: bool) -> None:
    text = """let close = near < 1 m
module stop { let slow = near > 1 m  when near < 3 m do drive(velocity = 0, turn = 0) }
network { drive = stop }
"""
    found = asked(f"{text}contract c: {contract}")
    assert [(d.code, d.span.text) for d in found] == ([("U004", "c")] if asks else [])


def test_a_contract_names_the_fewest_sensors() -> None:
    (one,) = asked("contract c: not fresh(near) and not fresh(bumper) and top > 0")
    assert "where `bumper`, `near` and `top` are missing" in one.message
    (one,) = asked("contract c: top > 0 and near > 0")
    assert "where `near` is missing" in one.message


def test_idle_hold_of_what_moves() -> None:
    robot = ROBOT.replace("robot r {", "robot r {\n actuator fan { speed : deg/s } to DServer.Fan idle hold")
    assert places("", robot) == [("U005", "hold")]


def test_decisions_are_at_places_of_the_new_text() -> None:
    (one,) = asked("# the robot's promises\n\nlet a = held(bumper, 1 s) contract c: a\n")
    assert one.span.source.position(one.span.start) == (5, 40)


# --- files -------------------------------------------------------------------------------------------


def test_a_part_is_upgraded_with_the_file_that_imports_it(tmp_path: Path) -> None:
    part, main = tmp_path / "part.colony", tmp_path / "main.colony"
    part.write_text("let slow = held(bumper, 1 s)\ncontract c: slow implies drive.velocity == 0\n")
    main.write_text(f'import "part.colony"\n{ROBOT}')
    (alone,) = upgrade_files([str(part)])
    assert alone.new is None
    assert "E301" in {d.code for d in alone.diagnostics}
    one, other = upgrade_files([str(part), str(main)])
    assert one.new == "language 2\n\n" + part.read_text().replace("held", "recently")
    assert [d.code for d in one.diagnostics] == ["U004"]
    assert other.new is not None


def test_errors_are_at_places_of_the_old_text(tmp_path: Path) -> None:
    path = tmp_path / "a.colony"
    path.write_text(f"# head\n\nlet a = held(bumper, 1 s) and nothing\n{ROBOT}")
    (found,) = upgrade_files([str(path)])
    (one,) = found.diagnostics
    assert (one.code, one.span.text) == ("E101", "nothing")
    assert one.span.source.position(one.span.start) == (3, 31)
    path.write_text("let a = = 3\n")
    (found,) = upgrade_files([str(path)])
    assert [(d.code, d.span.source.position(d.span.start)) for d in found.diagnostics] == [("E005", (1, 9))]


def test_a_file_that_is_named_twice_is_upgraded_once(tmp_path: Path) -> None:
    path, link = tmp_path / "a.colony", tmp_path / "b.colony"
    path.write_text(ROBOT)
    link.symlink_to(path)
    assert len(upgrade_files([str(path), str(path), str(link)])) == 1


# --- the check of versions ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("language 1", "`colony upgrade x.colony` rewrites the file"),
        ("language 3", "a newer colony reads it"),
        ("language 2.0", "write `language 2`"),
        ("language 0", "write `language 2`"),
        ("language 2 mm", "write `language 2`"),
    ],
)
def test_other_versions_are_refused_and_nothing_else_is_said(line: str, hint: str) -> None:
    (found,) = check_text(f"{line}\nlet a = held(nothing, 1 s)\nlet b = = 3\n", "x.colony").diagnostics
    version = line.removeprefix("language ")
    assert (found.code, found.hint, found.span.text) == ("E008", hint, line)
    assert found.message == f"found version {version} of the language; this is version 2"


def test_an_import_of_another_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / "old.colony").write_text(f"language 1\n{ROBOT}")
    (tmp_path / "main.colony").write_text('language 2\nimport "old.colony"\n')
    (found,) = check_file(tmp_path / "main.colony").diagnostics
    assert (found.code, Path(found.span.source.name).name) == ("E008", "old.colony")


def test_texts_without_the_line_are_version_2() -> None:
    program = load_text(f"let a = recently(bumper, 1 s){ROBOT}")
    assert program == load_text(f"language 2\nlet a = recently(bumper, 1 s){ROBOT}")


@pytest.mark.parametrize(
    "text", ["let a = 3\nlanguage 2\n", "language 2\nlanguage 2\n", "module m { when true\nlanguage 2 }"]
)
def test_a_line_that_is_not_first_has_a_hint(text: str) -> None:
    first = check_text(text).diagnostics[0]
    assert (first.code, first.hint) == ("E005", "a file has this line once, before its first declaration")


def test_errors_after_the_line_are_where_they_are() -> None:
    found = check_text(f"language 2\nlet a = = 3\n{ROBOT}").diagnostics
    assert [(d.code, d.span.source.position(d.span.start)) for d in found] == [("E005", (2, 9))]


# --- drawn programs ----------------------------------------------------------------------------------


@given(texts())
@settings(max_examples=40, deadline=None)
def test_any_program_of_version_1_means_the_same(text: str) -> None:
    old = re.sub(r"\brecently\(", "held(", text)
    new = upgraded(old)
    assert new == f"language 2\n\n{text}"
    assert load_text(new) == load_text(text)
    found = upgrade_tree(load_tree(Path("x.colony"), "x.colony", old))
    assert found.program is not None
    for one in decisions_about(found.program, found.diagnostics, found.files[-1].new.source):
        assert one.severity == "warning"


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_a_module_is_silent_without_the_sensors_that_it_needs(data: st.DataObject) -> None:
    program = data.draw(programs(python=False))
    missing, interpreter = Missing(program), Interpreter(program)
    for frame in data.draw(traces(program, max_frames=4)):
        interpreter.step(frame)
        fresh = {s.name: ir.Fresh(type=BOOL, name=s.name, derived=False) for s in program.robot.sensors}
        gone = frozenset(name for name, asked in fresh.items() if not interpreter.value_of(asked))
        for module in program.modules:
            if not module.failsafe:
                assert missing.is_silent(module.name, gone) == interpreter.is_silent(module.name), module.name


# --- names that have become units


_GRADE = "machine m {{ start a a -> {name} when near > {number} {name} -> a when bumper }}\n"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (_GRADE.format(name="b", number="5 mm"), []),
        (_GRADE.format(name="A", number="5 mm"), ["A"]),
        (_GRADE.format(name="V", number="near * 5"), ["5 V"]),
        ("param N = 2\nlet x = near / N", []),
        ("param N = 2\nlet x = 3 mm/N", ["3 mm/N"]),
        ("param N = 2\nlet x = (3 mm)/N  # 3 mm/N, 5 A", []),
        ("enum g { a = 1 }\nstate s : g = g.a", ["g"]),
        ("enum percent { a = 1 }\nlet x = percent.a", []),
        ("module kg2 { when near < 2 mm }\nlet n2 = near", []),
    ],
)
def test_names_that_have_become_units_are_named_and_the_file_stays(
    text: str, found: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "x.colony"
    path.write_text(text + ROBOT)
    [upgrade] = upgrade_files([str(path)])
    units = [d for d in upgrade.diagnostics if d.code == "U006"]
    assert [" ".join(d.span.text.split()) for d in units] == found
    assert (upgrade.new is None) == bool(found), upgrade.diagnostics


def test_a_file_that_imports_such_names_waits_for_them(tmp_path: Path) -> None:
    (tmp_path / "base.colony").write_text(_GRADE.format(name="A", number="5 mm") + ROBOT)
    (tmp_path / "main.colony").write_text('import "base.colony"\nlet x = near')
    [upgrade] = upgrade_files([str(tmp_path / "main.colony")])
    assert (upgrade.new, [d.code for d in upgrade.diagnostics]) == (None, ["U006"])


def test_a_file_that_reads_private_names_of_another_stays(tmp_path: Path) -> None:
    (tmp_path / "base.colony").write_text(f"let _n = near + 2 mm\n{ROBOT}")
    (tmp_path / "main.colony").write_text('import "base.colony"\nlet x = _n')
    main, base = upgrade_files([str(tmp_path / "main.colony"), str(tmp_path / "base.colony")])
    assert (main.new, [(d.code, d.span.text) for d in main.diagnostics]) == (None, [("E110", "_n")])
    assert base.new is not None
