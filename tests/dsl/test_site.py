"""Params of a site: the values that they give to programs, and what is reported of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import Checked, check_file
from colony.dsl.site_reading import MAX_BYTES, params_from_values, params_of, read_params
from colony.ir.program import Module, Program, PythonModule
from colony.ir.types import ScalarValue
from colony.text.diagnostics import Diagnostic

ROBOT = """
robot r {
  sensor   sonar[8] : mm   bearing 0 deg step 30 deg  range 0 .. reach  from PServer.sonar  within 300 ms
  sensor   bumper   : bool  from RServer.bumper
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s }  to RServer.drive
           idle drive(velocity = 0, turn = 0)
}
"""

MAIN = """language 1
import "robot"
import "parts" as p
enum gait { slow = 1, fast = 2 }
param cruising = 300 mm/s
param doubled = 2 * cruising
param low = 20 percent
param count = 3
param on = true
param step = gait.slow
param first = 0
param _own = 1
let near = bumper
module base {
  param gain = 1
  param more = gain + 1
  when true  do drive(velocity = cruising * gain, turn = 0)
}
module left = base(gain = 5)
module plain = base()
module py from python "a:B" { param speed = 100 mm/s  commands drive }
module view { when sonar[first] > 1 m and count > 0 and on and low > 10 percent }
network { drive = py suppresses p.avoid suppresses left suppresses plain suppresses base }
"""

PARTS = """language 1
param width = 2 m
module avoid { param clearance = 1 m  when min(sonar) < clearance + width do drive(velocity = 0, turn = 0) }
"""

PRIVATE = "param _p = 3\nmodule _w { param k = _p  when true }\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("main.colony").write_text(MAIN)
    Path("parts.colony").write_text(PARTS)
    Path("robot.colony").write_text(f"language 1\nparam reach = 10000\n{ROBOT}")
    return tmp_path


def check(toml: str, file: str = "main.colony") -> Checked:
    Path("site.toml").write_bytes(toml.encode())
    return check_file(file, params=read_params("site.toml"))


def program(toml: str) -> Program:
    checked = check(toml)
    assert checked.program is not None, checked.diagnostics
    return checked.program


def params(toml: str) -> dict[str, ScalarValue]:
    """The params of all modules by full names."""
    return {
        f"{m.name}.{name}": value
        for m in program(toml).modules
        if isinstance(m, Module | PythonModule)
        for name, value in m.params
    }


def errors(toml: str, file: str = "main.colony") -> list[Diagnostic]:
    return [d for d in check(toml, file).diagnostics if d.severity == "error"]


def places(toml: str) -> list[tuple[str, str]]:
    """The code of each error, with the place that it is about."""
    return [(d.code, repr(d.span)) for d in errors(toml)]


# --- what they do ------------------------------------------------------------------------------------


def test_values_stand_in_for_those_in_the_text(folder: Path) -> None:
    Path("same.colony").write_text(
        MAIN.replace("cruising = 300 mm/s", "cruising = 250 mm/s").replace("first = 0", "first = 2")
    )
    assert program('cruising = "0.25 m/s"\nfirst = 2') == check_file("same.colony").program
    assert program("") == check_file("main.colony").program


@pytest.mark.parametrize(
    "text",
    [
        '[p.avoid]\nclearance = "0.7 m"',
        'p.avoid.clearance = "0.7 m"',
        'p = { avoid = { clearance = "0.7 m" } }',
        '"p.avoid".clearance = """0.7 m"""',
        '\ufeffp.avoid.clearance = "700 mm"\r\n',
    ],
)
def test_names_are_written_as_tables_or_dots(folder: Path, text: str) -> None:
    assert params(text)["p.avoid.clearance"] == 700.0


def test_params_of_derived_modules(folder: Path) -> None:
    assert params("base.gain = 2") == params("") | {
        "base.gain": 2.0,
        "base.more": 3.0,
        "plain.gain": 2.0,
        "plain.more": 3.0,
    }
    assert params("left.gain = 7\nplain.more = 9") == params("") | {
        "left.gain": 7.0,
        "left.more": 8.0,
        "plain.more": 9.0,
    }
    assert params("py.speed = '50 mm/s'")["py.speed"] == 50.0


def test_values_are_texts_numbers_bools_and_members(folder: Path) -> None:
    found = program('count = 4\non = false\nstep = "fast"\nlow = "30 percent"\nfirst = 1').site
    assert dict(found.values) == {
        "count": "4",
        "on": "false",
        "step": "fast",
        "low": "30 percent",
        "first": "1",
    }
    for text in (
        'step = "gait.fast"',
        'count = "1e0"',
        'on = "true"',
        'cruising = "2 * 100 mm/s"',
        "low = 0",
    ):
        assert program(text)


def test_a_mapping_and_a_recorded_site_give_the_same(folder: Path) -> None:
    text = 'cruising = "250 mm/s"\ncount = 4\n[p.avoid]\nclearance = "0.7 m"'
    mapping = {"cruising": "250 mm/s", "count": 4, "p": {"avoid": {"clearance": "0.7 m"}}}
    by_file = program(text)
    by_mapping = check_file("main.colony", params=params_from_values(mapping, "<params>")).program
    by_record = check_file("main.colony", params=params_of(by_file.site)).program
    assert by_file == by_mapping == by_record
    assert by_file.site.hash == by_mapping.site.hash


def test_an_alias_of_the_main_file_leads_to_a_param_with_another_full_name(folder: Path) -> None:
    Path("parts.colony").write_text(PARTS)
    Path("main.colony").write_text(
        MAIN.replace('import "parts" as p', 'import "parts" as p\nimport "parts" as q')
    )
    assert params('q.avoid.clearance = "0.7 m"')["p.avoid.clearance"] == 700.0
    [twice] = errors('q.width = "1 m"\np.width = "1 m"')
    assert (twice.code, twice.message) == ("E703", "`p.width` is set twice")
    assert repr(twice.labels[0].span) == "site.toml:1:1"


# --- what is reported --------------------------------------------------------------------------------


def test_all_errors_are_reported_at_once_where_they_are(folder: Path) -> None:
    text = """# a site
cruisng = "1 mm/s"
cruising = 250
[p.avoid]
  clearance = "7 s"
[p.more]
deep = 1
"""
    assert places(text) == [
        *(("E703", "site.toml:2:1"), ("E704", "site.toml:3:12")),
        *(("E704", "site.toml:5:15"), ("E703", "site.toml:7:1")),
    ]
    assert [d.hint for d in errors(text)][:3] == [
        "did you mean `cruising`?",
        'write its unit, for example "250 mm/s"',
        "give it in m",
    ]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("near = true", "`near` is a let, not a param of the program"),
        ("bumper = true", "`bumper` is a sensor, not a param of the program"),
        ("base = 1", "`base` is a module, not a param of the program"),
        ("gait = 1", "`gait` is an enum, not a param of the program"),
        ("_own = 2", "`_own` is a name that belongs to its file, not a param of the program"),
        ("reach = 5000", "`reach` is a param of the robot's interface, which its description sets"),
        ("p = 1", "the program has no param `p`"),
        ("p.wdth = 1", "the program has no param `p.wdth`"),
        ("clearance = 1", "the program has no param `clearance`"),
    ],
)
def test_names_that_no_site_may_set(folder: Path, text: str, what: str) -> None:
    [found] = errors(text)
    assert (found.code, found.message) == ("E703", what)


def test_a_declared_name_is_not_taken_for_a_misspelled_param(folder: Path) -> None:
    file = folder / "main.colony"
    file.write_text(file.read_text() + "param nears = 1\n")
    [found] = errors("near = true")
    assert found.hint.startswith("its params are ")


@pytest.mark.parametrize(
    "text", ['"own:_p" = 5', '"own:_w.k" = 5', "[own._w]\nk = 5", "own._p = 5", "_p = 5"]
)
def test_private_names_that_two_files_have(folder: Path, text: str) -> None:
    own = f'language 1\nimport "robot"\n{PRIVATE}'
    Path("own.colony").write_text(own)
    Path("main.colony").write_text(
        f'language 1\nimport "own"\nimport "own" as own\nimport "robot"\n{PRIVATE}'
    )
    [found] = errors(text)
    assert found.code == "E703"
    assert found.message.endswith("is a name that belongs to its file, not a param of the program")
    assert found.hint == "it has no params"


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("cruising = inf", "`cruising` is a number that is infinite, no number, or too large"),
        ("count = nan", "`count` is a number that is infinite, no number, or too large"),
        ("count = [1]", "`count` is an array; expected one value"),
        ("count = 1979-05-27", "`count` is a value of the kind `date`"),
        ("count = true", "`count` is a plain number, found a bool"),
        ("on = 1", "`on` is a bool, found a plain number"),
        ('count = "1 m"', "`count` is a plain number, found a value in mm"),
        ("low = 20", "`low` is a value in percent, found a plain number"),
        ("low = 0.2", "`low` is a value in percent, found a plain number"),
        ('cruising = "bumper"', "`cruising`: `bumper` is not constant"),
        ('step = "run"', "`step`: unknown name `run`"),
        ('count = "1 let b = 2"', "`count` is more than a value"),
        ('count = "1\\nmodule m { when true }"', "`count` is more than a value"),
        (f'count = "{"1" * 2000}"', "`count` is a text of 2000 characters; at most 1000 are allowed"),
        ('count = "1 / 0"', "`count` is not a finite number"),
    ],
)
def test_values_that_a_param_cannot_have(folder: Path, text: str, what: str) -> None:
    [found] = errors(text)
    assert (found.code, found.message) == ("E704", what)
    assert found.span.source.name == "site.toml"


@pytest.mark.parametrize(
    ("given", "hint"),
    [
        ("20", 'write its unit, for example "20 percent"'),
        ("0.2", 'write its unit: 0.2 is "20 percent"'),
        ("-0.07", 'write its unit: -0.07 is "-7 percent"'),
    ],
)
def test_a_plain_number_for_percent_has_the_hint_that_means_the_same(
    folder: Path, given: str, hint: str
) -> None:
    [found] = errors(f"low = {given}")
    assert found.hint == hint


@pytest.mark.parametrize("text", ['count = ""', 'count = "1 +"', 'count = "mm/s 250"', 'count = "(((("'])
def test_invalid_values(folder: Path, text: str) -> None:
    [found] = errors(text)
    assert found.code == "E704"
    assert found.message.startswith("`count` is ")


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"a = 1 2", "E702"),
        (b"a = 1\na = 2", "E702"),
        (b"a = \xff", "E702"),
        (b"\0", "E702"),
        (b"a = " + b"[" * 5000 + b"]" * 5000, "E702"),
        (b"a = " + b"1" * 5000, "E702"),
        (b"#" * (MAX_BYTES + 1), "E701"),
        (b"a = 1\nb" + b".b" * 30_000 + b" = 1", "E702"),
        (b"colonyc\x05\x04\xff", "E702"),
    ],
)
def test_invalid_params_files(folder: Path, data: bytes, code: str) -> None:
    Path("site.toml").write_bytes(data)
    found = check_file("main.colony", params=read_params("site.toml"))
    assert [d.code for d in found.diagnostics if d.severity == "error"] == [code]


def test_a_folder_as_params_file(folder: Path) -> None:
    found = check_file("main.colony", params=read_params(folder))
    assert [d.code for d in found.diagnostics if d.severity == "error"] == ["E701"]


def test_a_robot_beside_the_behavior_sets_the_params_that_it_reads(folder: Path) -> None:
    text = f"language 1\nparam far = 5000\nparam reach = 2 * far\nparam other = 1\n{ROBOT}"
    Path("own.colony").write_text(text)
    [found] = errors("far = 1\nother = 2", "own.colony")
    assert found.message == "`far` is a param of the robot's interface, which its description sets"


def test_param_of_the_robot_with_the_name_of_a_modules_param_suggests_the_latter(folder: Path) -> None:
    module = (
        "module slow { param far = 2 when true do drive(velocity = 0, turn = 0) }\nnetwork { drive = slow }"
    )
    text = f"language 1\nparam far = 5000\nparam reach = 2 * far\n{ROBOT}{module}\n"
    Path("own.colony").write_text(text)
    [found] = errors("far = 1", "own.colony")
    assert found.hint == "did you mean `slow.far`?"


def test_an_error_that_comes_of_a_value_shows_it(folder: Path) -> None:
    found = errors("first = 9\ncount = 2")
    assert {d.code for d in found} == {"E205"}
    assert [(repr(label.span), label.text) for label in found[0].labels] == [
        ("site.toml:1:9", "the value of `first`, which stands in for the one in the program")
    ]


def test_errors_of_the_program_itself_do_not_show_values(folder: Path) -> None:
    Path("main.colony").write_text(MAIN + "\nlet broken = nothing")
    [found] = errors("first = 1")
    assert (found.code, found.labels) == ("E101", ())
