"""Imports: which names come in, by what they are called, and what stays behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import check_file, check_text, load_file, load_text
from colony.ir import expression as e
from colony.ir.program import Chain, Let, Module, Program, PythonModule, Use
from colony.ir.types import DISTANCE
from colony.text.diagnostics import headline, render
from tests.dsl.texts import ROBOT

MODULE = "module {0} {{ param near = 1 m when sonar[12] < near do drive(velocity = 0, turn = 0) }}\n"


class Files:
    """A folder to write a program into."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.write(rome=ROBOT)

    def write(self, **texts: str) -> None:
        for name, text in texts.items():
            path = self.folder / (name.replace("__", "/") + ".colony")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)

    def program(self, root: str) -> Program:
        checked = check_file(self.folder / f"{root}.colony")
        assert checked.program is not None, "\n".join(render(d) for d in checked.diagnostics)
        return checked.program

    def findings(self, root: str) -> list[str]:
        """`file:line:column code` of each error and warning but those about unused parts."""
        found = []
        for d in check_file(self.folder / f"{root}.colony").diagnostics:
            place, _, rest = headline(d).partition(": ")
            if d.code not in ("W001", "W002"):
                found.append(f"{Path(place).name} {d.code}" if "/" in place else f"{place} {rest}")
        return found


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def wiring_of(program: Program, name: str) -> object:
    [wire] = [w for w in program.wires if w.name == name]
    return wire.wiring


def test_a_plain_import_brings_in_all_names(files: Files) -> None:
    files.write(
        brooks='import "rome.colony"\nparam far = 3 m\nlet ahead = sonar[12]\n' + MODULE.format("avoid"),
        main='import "brooks.colony"\nlet close = ahead < far\nnetwork { drive = avoid }',
    )
    program = files.program("main")
    assert [m.name for m in program.modules] == ["avoid"]
    close = program.derived[1]
    assert isinstance(close, Let)
    assert isinstance(close.expression, e.BinaryOperation)
    assert isinstance(close.expression.left, e.DerivedValue)
    assert close.expression.left.name == "ahead"


def test_as_puts_names_behind_an_alias(files: Files) -> None:
    files.write(
        brooks='import "rome.colony"\nenum goal { light = 76 }\nlet ahead = sonar[12]\n'
        "machine mode { start one one -> two when bumper }\nstate s = 0\n" + MODULE.format("avoid"),
        main="""import "brooks.colony" as brooks
        let a = brooks.ahead < 1 m and brooks.mode == brooks.mode.two and brooks.s == 0
        let f = fresh(brooks.ahead)
        state g : brooks.goal = brooks.goal.light
        module mine = brooks.avoid(near = 2 m)
        network { drive = brooks.avoid suppresses mine }
        contract c: drive by brooks.avoid implies brooks.avoid.near == 1 m""",
    )
    program = files.program("main")
    assert [m.name for m in program.modules] == ["brooks.avoid", "mine"]
    assert sorted(d.name for d in program.derived) == [
        "a",
        "brooks.ahead",
        "brooks.mode",
        "brooks.s",
        "f",
        "g",
    ]
    assert isinstance(wiring := wiring_of(program, "drive"), Chain)
    assert wiring.operands == (Use(name="brooks.avoid"), Use(name="mine"))


def test_names_behind_an_alias_are_not_there_without_it(files: Files) -> None:
    files.write(
        brooks='import "rome.colony"\nlet ahead = sonar[12]\n' + MODULE.format("avoid"),
        main='import "brooks.colony" as brooks\nlet a = ahead\nnetwork { drive = avoid }\nlet b = brooks.no',
    )
    assert files.findings("main") == ["main.colony:2:9 E101", "main.colony:3:19 E101", "main.colony:4:9 E101"]


def test_the_robots_names_are_never_prefixed(files: Files) -> None:
    files.write(
        main='import "rome.colony" as rome\nlet a = sonar[12]\n'
        + MODULE.format("m")
        + "network { drive = m }"
    )
    program = files.program("main")
    assert program.robot.sensors[0].name == "sonar"
    assert files.findings("main") == []
    files.write(
        main='import "rome.colony" as rome\nlet a = rome.sonar[12]\ncontract c: rome.drive.velocity < 0\n'
        "contract d: rome.drive is idle"
    )
    assert files.findings("main") == [f"main.colony:{at} E101" for at in ("2:9", "3:13", "4:13")]


def test_every_file_sees_the_robot_whoever_imports_it(files: Files) -> None:
    files.write(lib="let ahead = sonar[12]", main='import "lib.colony"\nimport "rome.colony"\nlet a = ahead')
    assert files.findings("main") == []


def test_aliases_nest(files: Files) -> None:
    files.write(
        c='import "rome.colony"\nlet deep = 3\n' + MODULE.format("m"),
        b='import "c.colony" as c\nlet middle = c.deep',
        a='import "b.colony" as b\nlet x = b.middle + b.c.deep\nnetwork { drive = b.c.m }',
    )
    program = files.program("a")
    assert [d.name for d in program.derived] == ["b.c.deep", "b.middle", "x"]
    assert wiring_of(program, "drive") == Use(name="b.c.m")


def test_an_alias_comes_in_with_a_plain_import(files: Files) -> None:
    files.write(
        c='import "rome.colony"\nlet deep = 3',
        b='import "c.colony" as c',
        a='import "b.colony"\nlet x = c.deep',
    )
    assert [d.name for d in files.program("a").derived] == ["c.deep", "x"]


def test_a_file_imported_twice_counts_once(files: Files) -> None:
    files.write(
        top='import "rome.colony"\nlet shared = sonar[12]\ncontract c: shared >= 0',
        left='import "top.colony"\nlet l = shared',
        right='import "top.colony"\nimport "./top.colony"\nlet r = shared',
        main='import "left.colony"\nimport "right.colony" as right\n'
        "let m = l + right.r + right.shared + shared",
    )
    program = files.program("main")
    assert [d.name for d in program.derived] == ["shared", "l", "right.r", "m"]
    assert [c.name for c in program.contracts] == ["c"]


def test_the_name_with_the_fewest_aliases_counts(files: Files) -> None:
    files.write(
        base='import "rome.colony"\nlet x = 3',
        main='import "base.colony" as far\nimport "base.colony" as near\nlet y = far.x + near.x',
    )
    assert [d.name for d in files.program("main").derived] == ["far.x", "y"]


def test_imports_are_relative_to_the_file(files: Files) -> None:
    files.write(
        parts__more__a='import "../b.colony"\nlet a = b',
        parts__b='import "../rome.colony"\nlet b = 3',
        main='import "parts/more/a.colony"\nlet m = a',
    )
    assert files.findings("main") == []


def test_a_text_imports_from_its_directory(files: Files) -> None:
    checked = check_text('import "rome.colony"\nlet a = sonar[1]', directory=files.folder)
    assert checked.program is not None


def test_an_imported_network_drives_nothing_by_itself(files: Files) -> None:
    files.write(
        brooks='import "rome.colony"\n' + MODULE.format("avoid") + "network { low = avoid drive = low }",
        main='import "brooks.colony" as brooks\n'
        + MODULE.format("mine")
        + "network { drive = mine suppresses brooks.drive }",
    )
    program = files.program("main")
    assert {w.name: w.actuator for w in program.wires} == {
        "brooks.low": None,
        "brooks.drive": None,
        "drive": "drive",
    }
    assert isinstance(wiring := wiring_of(program, "drive"), Chain)
    assert wiring.operands[1] == Use(name="brooks.drive")


def test_a_plainly_imported_network_drives_nothing_either(files: Files) -> None:
    files.write(
        brooks='import "rome.colony"\n' + MODULE.format("avoid") + "network { drive = avoid }",
        main='import "brooks.colony"\n' + MODULE.format("mine") + "network { drive = mine }",
    )
    program = files.program("main")
    assert [w.actuator for w in program.wires] == [None, "drive"]
    assert wiring_of(program, "drive") == Use(name="mine")


def test_two_imported_networks_each_keep_their_wiring(files: Files) -> None:
    """`a.drive` is what `a` assigns, not what a file that `a` imports plainly does."""
    files.write(
        inner='import "rome.colony"\n' + MODULE.format("low") + "network { drive = low }",
        a='import "inner.colony"\n' + MODULE.format("high") + "network { drive = high }",
        main='import "a.colony" as a\nnetwork { drive = a.drive }',
    )
    program = files.program("main")
    assert wiring_of(program, "a.drive") == Use(name="a.high")
    assert wiring_of(program, "drive") == Use(name="a.drive")
    assert len({w.name for w in program.wires}) == 3


def test_files_of_one_name_in_two_folders(files: Files) -> None:
    for folder in "xy":
        files.write(
            **{
                f"{folder}__net": 'import "../rome.colony"\n'
                + MODULE.format(folder)
                + f"network {{ drive = {folder} }}"
            }
        )
    files.write(main='import "x/net.colony"\nimport "y/net.colony"\nnetwork { drive = x suppresses y }')
    program = files.program("main")
    assert len({w.name for w in program.wires}) == 3


def test_tests_stay_behind_while_contracts_and_limits_come_in(files: Files) -> None:
    files.write(
        brooks="""import "rome.colony"
        limit drive.velocity <= 100 mm/s
        contract safe: drive.velocity >= 0
        test "mine" { at 0 s }""",
        main="""import "brooks.colony" as b
        contract safe: true
        limit drive.velocity <= 50 mm/s
        test "own" { at 0 s }""",
    )
    program = files.program("main")
    assert [t.name for t in program.tests] == ["own"]
    assert [c.name for c in program.contracts] == ["b.safe", "safe"]
    bounds = [limit.bound for limit in program.limits]
    assert [b.value for b in bounds if isinstance(b, e.Constant)] == [100.0, 50.0]


def test_a_derived_module_lives_where_its_base_was_written(files: Files) -> None:
    files.write(
        base='import "rome.colony"\nparam unit = 10 mm\nlet ahead = sonar[12]\n'
        "module avoid { param n = 3 param near = n * unit when ahead < near do lamp(on = true, level = 0) }",
        more='import "base.colony" as base\nmodule farther = base.avoid(n = 5)',
        main='import "more.colony" as more\nparam unit = 1 s\nmodule mine = more.farther(n = 7)\n'
        "module again = more.base.avoid(near = 1 m)",
    )
    modules = {m.name: m for m in files.program("main").modules}
    assert list(modules) == ["more.base.avoid", "more.farther", "mine", "again"]
    assert modules["mine"].params == (("n", 7.0), ("near", 70.0))
    assert modules["again"].params == (("n", 3.0), ("near", 1000.0))
    mine = modules["mine"]
    assert isinstance(mine, Module)
    assert isinstance(mine.when, e.BinaryOperation)
    assert isinstance(mine.when.left, e.DerivedValue)
    assert mine.when.left.name == "more.base.ahead"


# --- errors --------------------------------------------------------------------------------------


def test_a_cycle_is_reported_where_it_closes(files: Files) -> None:
    files.write(a='import "b.colony"', b='import "c.colony"', c='import "rome.colony"\nimport "a.colony"')
    assert files.findings("a") == ["c.colony:2:1 E104"]
    [found] = check_file(files.folder / "a.colony").diagnostics
    assert (
        found.message == "files import each other in a cycle: "
        "`a.colony` imports `b.colony` imports `c.colony` imports `a.colony`"
    )


def test_a_file_that_imports_itself(files: Files) -> None:
    files.write(a='import "rome.colony"\nimport "a.colony"\nimport "./a.colony" as me\nlet x = 3')
    assert files.findings("a") == ["a.colony:2:1 E104", "a.colony:3:1 E104"]


def test_what_cannot_be_read_is_reported_at_the_import(files: Files) -> None:
    (files.folder / "folder").mkdir()
    (files.folder / "loop").symlink_to(files.folder / "loop")
    files.write(
        main='import "rome.colony"\nimport "nothing.colony"\nimport "folder"\nimport "loop"\n'
        'import "/dev/zero"\nimport ""\nimport "nothing.colony" as again'
    )
    expected = [f"main.colony:{line}:1 E103" for line in (2, 3, 4, 5, 6)]
    assert files.findings("main") == expected


def test_nobody_misses_the_names_of_a_file_that_could_not_be_read(files: Files) -> None:
    files.write(
        main='import "rome.colony"\nimport "nothing.colony"\nimport "neither.colony" as n\n'
        "module m = base(x = 3)\nlet a = b + n.c\nnetwork { drive = n.d suppresses e }\nlimit lamp.x <= 3"
    )
    assert files.findings("main") == ["main.colony:2:1 E103", "main.colony:3:1 E103", "main.colony:7:12 E601"]


def test_nobody_misses_the_names_that_a_broken_file_seems_to_declare(files: Files) -> None:
    files.write(
        lib='import "rome.colony"\nlet good = 3\nmodule bad { when }\nlet worse = = 3',
        main='import "lib.colony"\nlet a = good + worse\nnetwork { drive = bad }\nlet b = nobody',
    )
    assert files.findings("main") == ["lib.colony:3:19 E005", "lib.colony:4:13 E005", "main.colony:4:9 E101"]


def test_an_error_in_an_imported_file_is_told_once(files: Files) -> None:
    files.write(
        lib='import "rome.colony"\nlet a = nobody',
        left='import "lib.colony"\nlet b = a',
        main='import "lib.colony" as lib\nimport "left.colony"\nlet c = lib.a + b',
    )
    assert files.findings("main") == ["lib.colony:2:9 E101"]


def test_bytes_that_are_no_text_are_shown_in_their_file(files: Files) -> None:
    (files.folder / "bad.colony").write_bytes(b"let a = 3\nlet b = \xff\n")
    (files.folder / "nul.colony").write_bytes(b"let a = 3\nlet \0b = 3\n")
    files.write(main='import "rome.colony"\nimport "bad.colony"\nimport "nul.colony"')
    assert files.findings("main") == ["bad.colony:2:9 E002", "nul.colony:2:5 E002"]


def test_names_clash(files: Files) -> None:
    files.write(
        a='import "rome.colony"\nlet x = 3\n' + MODULE.format("m"),
        b='import "rome.colony"\nlet x = 4\n' + MODULE.format("m"),
        main='import "a.colony"\nimport "b.colony"\n',
        own='import "a.colony"\nlet x = 4\n' + MODULE.format("m"),
        fine='import "a.colony"\nimport "b.colony" as b\nlet y = x + b.x',
    )
    assert files.findings("main") == ["main.colony:2:1 E102", "main.colony:2:1 E102"]
    assert files.findings("own") == ["own.colony:1:1 E102", "own.colony:1:1 E102"]
    assert files.findings("fine") == []


def test_aliases_clash(files: Files) -> None:
    files.write(
        a='import "rome.colony"\nlet x = 3',
        b='import "rome.colony"\nlet y = 3',
        two='import "a.colony" as n\nimport "b.colony" as n',
        name='import "a.colony" as n\nlet n = 3',
        sensor='import "a.colony" as sonar',
        actuator='import "a.colony" as drive',
        same='import "a.colony" as n\nimport "a.colony" as n\nlet z = n.x',
    )
    assert files.findings("two") == ["two.colony:2:22 E102"]
    assert files.findings("name") == ["name.colony:1:22 E102"]
    assert files.findings("sensor") == ["sensor.colony:1:22 E102"]
    assert files.findings("actuator") == ["actuator.colony:1:22 E102"]
    assert files.findings("same") == []


def test_two_robots(files: Files) -> None:
    files.write(other="robot other { }", main='import "rome.colony"\nimport "other.colony"')
    assert files.findings("main") == ["other.colony:1:7 E302"]


def test_a_program_needs_a_robot(files: Files) -> None:
    files.write(main="let a = sonar[1]\nmodule m { when b > 3 do drive(v = 3) }")
    assert files.findings("main") == ["main.colony:1:1 E301"]


def test_the_state_of_another_file_has_no_next_here(files: Files) -> None:
    files.write(lib='import "rome.colony"\nstate s = 0', main='import "lib.colony"\nnext s = s + 1')
    assert files.findings("main") == ["main.colony:2:6 E403"]


def test_unused_parts_of_imported_files_are_no_warning(files: Files) -> None:
    files.write(
        lib='import "rome.colony"\n' + MODULE.format("unused") + "network { idle_wire = unused }",
        main='import "lib.colony"\n'
        + MODULE.format("used")
        + MODULE.format("spare")
        + "network { drive = used }",
    )
    found = [(d.code, d.message) for d in check_file(files.folder / "main.colony").diagnostics]
    assert found == [("W001", "module `spare` reaches no actuator")]


def test_of_an_imported_robot_only_what_holds_may_be_left_undriven(files: Files) -> None:
    files.write(
        main='import "rome.colony"\nmodule m { when true do lamp(on = true, level = 0) }\n'
        "network { lamp = m }",
        other='import "rome.colony"\n' + MODULE.format("m") + "network { drive = m }",
    )
    found = [(d.code, d.message) for d in check_file(files.folder / "main.colony").diagnostics]
    assert found == [("W002", "nothing drives actuator `drive`")]
    assert check_file(files.folder / "other.colony").diagnostics == ()


def test_contracts_of_an_imported_network_that_drives_nothing_are_warned_of(files: Files) -> None:
    contract = "contract slow: drive.velocity <= 1 m/s"
    files.write(
        driving='import "rome.colony"\n' + MODULE.format("m") + "network { drive = m }",
        main=f'import "driving.colony"\n{contract}',
        driven=f'import "driving.colony" as driving\nnetwork {{ drive = driving.drive }}\n{contract}',
        robot_only=f'import "rome.colony"\n{contract}',
    )
    [found] = check_file(files.folder / "main.colony").diagnostics
    assert (found.code, found.hint) == (
        "W002",
        "the network of an imported file drives nothing here: import the file `as NAME`, and write "
        "`network { drive = NAME.drive }`",
    )
    for name in ("driven", "robot_only"):
        assert check_file(files.folder / f"{name}.colony").diagnostics == ()


def test_a_long_chain_of_imports(files: Files) -> None:
    for i in range(900):
        files.write(**{f"c{i}": f'import "c{i + 1}.colony"\nlet x{i} = x{i + 1} + 1\n'})
    files.write(c900='import "rome.colony"\nlet x900 = 0')
    assert len(files.program("c0").derived) == 901


def test_an_endless_chain_of_imports_ends(files: Files) -> None:
    for i in range(1100):
        files.write(**{f"c{i}": f'import "c{i + 1}.colony"\n'})
    files.write(main='import "rome.colony"\nimport "c0.colony"')
    assert files.findings("main") == ["c997.colony:1:1 E103"]


def test_a_python_module_is_given_what_it_reads_by_the_names_of_its_own_file(tmp_path: Path) -> None:
    (tmp_path / "far.colony").write_text(
        'let ahead = near * 2\nmodule m from python "some.where:Thing" { reads ahead, near commands drive }\n'
    )
    (tmp_path / "main.colony").write_text(
        'import "far.colony" as far\n'
        "robot r { sensor near : mm from P.near\n"
        "  actuator drive { v : mm/s } to R.drive idle drive(v = 0) }\n"
        "network { drive = far.m }\n"
    )
    (module,) = load_file(tmp_path / "main.colony").modules
    assert isinstance(module, PythonModule)
    assert [r.name for r in module.reads] == ["ahead", "near"]
    assert module.reads[0].expression == e.DerivedValue(type=DISTANCE, name="far.ahead")


def test_a_program_has_its_texts_by_their_places(tmp_path: Path) -> None:
    """Places are those by which files import each other, in the folder that has all of them."""
    for folder in ("a/b", "c", "elsewhere"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "a" / "b" / "root.colony").write_text('import "../../c/linked.colony"\n' + ROBOT)
    (tmp_path / "elsewhere" / "real.colony").write_text('import "../a/more.colony"\n')
    (tmp_path / "c" / "linked.colony").symlink_to("../elsewhere/real.colony")
    (tmp_path / "a" / "more.colony").write_text("param limit = 1\n")
    loaded = load_file(tmp_path / "a" / "b" / "root.colony")
    assert [place for place, _ in loaded.files] == ["a/more.colony", "c/linked.colony", "a/b/root.colony"]
    assert loaded.files[0][1].text == "param limit = 1\n"
    (only,) = load_text(ROBOT, name="x/y.colony", directory=tmp_path).files
    assert (only[0], only[1].text) == ("y.colony", ROBOT)
    ((place, _),) = load_text(ROBOT).files
    assert place == "<text>"


def test_a_test_gives_a_sensor_its_value_by_the_name_of_a_name(tmp_path: Path) -> None:
    files = Files(tmp_path)
    files.write(
        named='import "rome"\nlet ranges = sonar\nlet twice = 2 * sonar',
        top="""
        import "named" as robot_names
        let scan = robot_names.ranges
        let again = scan
        let twice = robot_names.twice
        test "t" { at 0 s given again = 3 m, scan[0] = 1 m expect sonar[0] == 1 m }
        test "u" { at 0 s given twice = 3 m }
        """,
    )
    assert files.findings("top") == ["top.colony:7:33 E603"]


def test_what_imported_modules_did_in_the_frame_before_has_their_full_names(files: Files) -> None:
    files.write(
        brooks='import "rome.colony"\nlet stuck = last._idle is active\nlet through = last.drive by avoid\n'
        + MODULE.format("avoid")
        + MODULE.format("_idle"),
        main="""import "brooks.colony" as brooks
let own = last.drive by brooks.avoid and last.turn is active and not brooks.stuck and brooks.through
module turn { when own do drive(velocity = 0, turn = 0) }
network { drive = turn suppresses brooks.avoid }
""",
        private='import "brooks.colony" as brooks\nlet own = last.brooks._idle is active',
    )
    program = files.program("main")
    roles = [s.name for s in program.robot.sensors if s.sent is not None]
    assert roles == [
        "last.brooks._idle is active",
        "last.drive by brooks.avoid",
        "last.turn is active",
    ]
    assert files.findings("private") == ["private.colony:2:23 E110"]
