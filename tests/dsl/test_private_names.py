"""Names that begin with `_` belong to their file: imports leave them out, and full names stay unique."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

import colony
from colony.dsl.load import check_file
from colony.text.diagnostics import render
from colony.verify.testing.agreement import ALL_EXECUTORS, disagreement
from colony.verify.testing.frames import Choices, draw_trace
from tests.dsl.test_imports import Files
from tests.dsl.texts import findings

PART = """
import "rome"
param _far = {0} mm
enum _goal {{ none = 0, light = 1 }}
let _near(r : mm) = recently(r < _far, 100 ms)
let _ahead = sonar[{0}]
state _count = _goal.none
next _count = if _near(_ahead) then _goal.light else _goal.none
machine _mode {{ start a  a -> b when _near(_ahead)  b -> a when not _near(_ahead) }}
module _rest {{ param _speed = {0} mm/s  when _mode == _mode.b do drive(velocity = _speed, turn = 0) }}
module go{0} {{ when _count == _goal.light do drive(velocity = {0} mm/s, turn = 0) }}
network {{ _own = _rest suppresses go{0}  way{0} = _own }}
contract _holds: not (_own is active) or _rest._speed > 0
"""


@pytest.fixture
def files(tmp_path: Path) -> Files:
    made = Files(tmp_path)
    made.write(one=PART.format(1), two=PART.format(2))
    return made


def test_two_imported_files_may_have_the_same_private_names(files: Files) -> None:
    files.write(
        top='import "one"\nimport "two"\nnetwork { drive = way1 suppresses way2 }\nlet _ahead = sonar[9]'
    )
    whole = files.program("top")
    names = [x.name for x in (*whole.derived, *whole.modules, *whole.wires, *whole.contracts)]
    assert len(set(names)) == len(names)
    assert {"_ahead", "two:_ahead", "one:_ahead", "_rest", "one:_rest", "_own", "one:_own"} <= set(names)
    assert {"_holds", "one:_holds"} == {c.name for c in whole.contracts}


def test_all_executors_agree_on_private_names(files: Files) -> None:
    files.write(top='import "one"\nimport "two" as b\nnetwork { drive = way1 suppresses b.way2 }')
    whole = files.program("top")
    trace = draw_trace(Choices(Random(1)), whole, 12)
    assert disagreement(whole, trace, ALL_EXECUTORS) is None


USES = [
    ("let x = _ahead", "_ahead", "let x = "),
    ("let x = one._ahead", "_ahead", "let x = "),
    ("let x = _near(sonar[0])", "_near", "let x = "),
    ("let x = one._near(sonar[0])", "_near", "let x = "),
    ("let x = fresh(one._ahead)", "_ahead", "let x = fresh("),
    ("param x = one._far", "_far", "param x = "),
    ("let x = one._goal.light == one._goal.light", "_goal", "let x = "),
    ("state x : one._goal = 0", "_goal", "state x : "),
    ("let x = one._count == one._count", "_count", "let x = "),
    ("let x = one._mode == one._mode.a", "_mode", "let x = "),
    ("module m = one._rest", "_rest", "module m = "),
    ("network { w = one._own }", "_own", "network { w = "),
    ("contract c: one._rest is active", "_rest", "contract c: "),
]


@pytest.mark.parametrize(("text", "name", "before"), USES, ids=[text for text, _, _ in USES])
def test_a_private_name_is_not_brought_in(files: Files, text: str, name: str, before: str) -> None:
    head = 'import "rome"\nimport "one"' + (" as one" if "one." in text else "")
    files.write(top=f"{head}\n{text}")
    found = [d for d in check_file(files.folder / "top.colony").diagnostics if d.severity == "error"]
    shown = "\n".join(render(d) for d in found)
    assert {d.code for d in found} == {"E110"}, shown
    assert f"top.colony:3:{len(before) + 1}: error[E110]: `{name}` belongs to `" in shown
    assert "one.colony`\n" in shown
    assert "hint: a name that begins with `_` can be used only in its file" in shown


def test_private_members_of_modules(files: Files) -> None:
    files.write(
        base='import "rome"\nmodule m { param _p = 1 m input _i : mm = sonar[0] when _i < _p }\n'
        "module n = m(_p = 2 m)",
        top='import "base"\nmodule k = m(_p = 3 m)\nmodule l = m(_i = 3 m)\nmodule j = m\n'
        "contract c: j._i < 1 m",
    )
    assert files.findings("base") == []
    assert [f for f in files.findings("top") if "E" in f.split()[1]] == [
        "top.colony:2:14 E110",
        "top.colony:3:14 E110",
        "top.colony:5:13 E110",
    ]


def test_a_private_alias_is_not_brought_in(files: Files) -> None:
    files.write(
        middle='import "one" as _one',
        plainly='import "rome"\nimport "middle"\nnetwork { w = _one.way1 }',
        by_alias='import "rome"\nimport "middle" as m\nnetwork { w = m._one.way1 }',
    )
    assert files.findings("plainly") == ["plainly.colony:3:15 E110"]
    assert files.findings("by_alias") == ["by_alias.colony:3:15 E110"]


def test_an_undeclared_name_is_unknown(files: Files) -> None:
    files.write(top='import "rome"\nimport "one" as one\nlet x = one._nothing\nlet y = _nothing')
    assert files.findings("top") == ["top.colony:3:9 E101", "top.colony:4:9 E101"]


def test_the_robot_is_for_all_files(tmp_path: Path) -> None:
    files = Files(tmp_path)
    files.write(
        robot="robot r { sensor _b : bool from D.b actuator _a { on : bool } to D.a idle hold }",
        top='import "robot" as robot\nmodule m { when _b do _a(on = true) }\nnetwork { _a = m }',
    )
    assert files.findings("top") == []


def test_a_name_of_this_file_is_only_used_too_early() -> None:
    assert findings("let z = _near\nlet _near = 3 m") == ["1:9 E105"]


def test_what_has_private_modules_compiles_and_is_saved(tmp_path: Path) -> None:
    files = Files(tmp_path)
    files.write(
        one=PART.format(1), top='import "one"\nimport "2-more"\nnetwork { drive = way1 suppresses way2 }'
    )
    (tmp_path / "2-more.colony").write_text((tmp_path / "one.colony").read_text().replace("1", "2"))
    build = colony.build(colony.load(tmp_path / "top.colony"))
    assert ":_rest" in build.table()
    build.save(tmp_path / "top.colonyc")
    colony.read(tmp_path / "top.colonyc")
