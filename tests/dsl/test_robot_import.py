"""`import robot`: which robot it is, and what is said where it is none."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from colony.dsl.descriptions import RobotChoice
from colony.dsl.load import Checked, check_file, check_text, load_file, load_text
from colony.dsl.parse import parse
from colony.dsl.printer import print_file
from colony.ir.program import Program
from colony.text.source import Source
from tests.paths import ROBOTS, ROOT

GO = """language 1
import robot
module go { when true do drive(velocity = 100 mm/s, turn = 0) }
network { drive = go }
"""


def description(name: str, top: int = 500) -> str:
    return (
        f"param top_speed = {top} mm/s\n"
        f"robot {name} {{ actuator drive {{ velocity : mm/s range 0 .. {top}, turn : deg/s }}"
        " to RServer.drive idle drive(velocity = 0, turn = 0) }\n"
    )


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project with a behavior, and with two robots of its own."""
    (tmp_path / "project" / "robots").mkdir(parents=True)
    (tmp_path / "project" / "deep" / "er").mkdir(parents=True)
    folder = tmp_path / "project"
    (folder / "go.colony").write_text(GO)
    (folder / "deep" / "er" / "go.colony").write_text(GO)
    for name in ("amr", "cart"):
        (folder / "robots" / f"{name}.colony").write_text(description(name))
    monkeypatch.chdir(folder)
    return folder


def codes(checked: Checked) -> list[str]:
    return [d.code for d in checked.diagnostics if d.severity == "error"]


def robot_of(program: Program | None) -> str:
    return program.robot.name


# --- what says which robot it is


def test_the_caller_says_it(project: Path) -> None:
    for text in ("amr", "cart", "rome", "robots/amr.colony", str(project / "robots" / "cart.colony")):
        assert robot_of(load_file("go.colony", robot=text)) == Path(text).stem
        assert robot_of(load_text(GO, robot=text)) == Path(text).stem


def test_a_project_says_it_for_all_folders_in_it(project: Path) -> None:
    (project / "colony.toml").write_text('robot = "amr"\n')
    for path in ("go.colony", "deep/er/go.colony", str(project / "go.colony")):
        assert robot_of(load_file(path)) == "amr"
    assert robot_of(load_file("go.colony", robot="cart")) == "cart"


def test_the_nearest_project_counts_and_nothing_above_it(project: Path) -> None:
    (project / "colony.toml").write_text('robot = "amr"\n')
    (project / "deep" / "colony.toml").write_text('robot = "../robots/cart.colony"\n')
    assert robot_of(load_file("deep/er/go.colony")) == "cart"
    (project / "deep" / "colony.toml").write_text("")
    assert codes(check_file("deep/er/go.colony")) == ["E320"]


def test_pyproject_says_it_in_a_table_of_its_own(project: Path) -> None:
    (project / "pyproject.toml").write_text('[tool.colony]\nrobot = "amr"\n')
    (project / "deep" / "pyproject.toml").write_text('[project]\nname = "deep"\n')
    assert robot_of(load_file("deep/er/go.colony")) == "amr"
    (project / "colony.toml").write_text('robot = "cart"\n')
    assert robot_of(load_file("deep/er/go.colony")) == "cart"


def test_a_file_of_the_program_says_it(project: Path) -> None:
    (project / "colony.toml").write_text('robot = "amr"\n')
    (project / "own.colony").write_text('import "go.colony" as go\n' + description("own"))
    (project / "by_path.colony").write_text('import "robots/cart.colony"\nimport "go.colony" as go\n')
    assert robot_of(load_file("own.colony")) == "own"
    assert robot_of(load_file("by_path.colony")) == "cart"
    assert robot_of(load_file("by_path.colony", robot="cart")) == "cart"
    assert codes(check_file("by_path.colony", robot="amr")) == ["E322"]
    assert codes(check_file("own.colony", robot="amr")) == ["E322"]
    assert codes(check_file("own.colony", robot="nobody")) == ["E321"]


def test_the_robot_of_a_file_in_a_project_is_found_from_any_folder(
    project: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (project / "colony.toml").write_text("")
    (project / "by_path.colony").write_text('import "robots/cart.colony"\nimport "go.colony" as go\n')
    monkeypatch.chdir(tmp_path)
    assert robot_of(load_file(project / "by_path.colony", robot="cart")) == "cart"


def test_a_name_at_run_time_need_not_be_a_description(project: Path) -> None:
    (project / "colony.toml").write_text('robot = "amr"\n')
    (project / "own.colony").write_text(description("own"))
    named = [RobotChoice(text=text, origin="--robot", is_name=True) for text in ("lab", "cart")]
    assert [robot_of(load_file("go.colony", robot=name)) for name in named] == ["amr", "cart"]
    assert [robot_of(load_file("own.colony", robot=name)) for name in named] == ["own", "own"]


def test_a_behavior_of_colony_is_of_the_current_folders_project(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (project / "colony.toml").write_text('robot = "amr"\n')
    monkeypatch.setattr("colony.shipped._FOLDER", project / "deep")
    (project / "deep" / "behaviors").mkdir()
    (project / "deep" / "colony.toml").write_text('robot = "cart"\n')
    shipped = project / "deep" / "behaviors" / "go.colony"
    shipped.write_text(GO)
    assert robot_of(load_file(shipped)) == "amr"


# --- what it brings in


def test_names_of_the_description_are_there(project: Path) -> None:
    text = GO + "param mine = top_speed / 2\nlet a = frame_period > 0 s\n"
    assert robot_of(load_text(text, robot="amr")) == "amr"
    assert codes(check_text(GO + "param top_speed = 3\n", robot="amr")) == ["E102"]


def test_an_imported_file_with_import_robot_needs_no_other(project: Path) -> None:
    (project / "main.colony").write_text(
        'import "go.colony" as go\nmodule mine = go.go()\nnetwork { drive = mine }'
    )
    assert robot_of(load_file("main.colony", robot="amr")) == "amr"


def test_it_may_be_said_in_many_files_and_twice(project: Path) -> None:
    (project / "a.colony").write_text("import robot\nimport robot\nparam half = top_speed / 2\n")
    (project / "b.colony").write_text('import robot\nimport "a.colony"\nparam other = half + top_speed\n')
    assert robot_of(load_file("b.colony", robot="amr")) == "amr"


def test_a_robot_whose_own_file_imports_the_behavior(project: Path) -> None:
    (project / "main.colony").write_text('import "go.colony"\n' + description("own"))
    assert robot_of(load_file("main.colony")) == "own"
    (project / "robots" / "round.colony").write_text('import "../go.colony"\n' + description("round"))
    assert codes(check_file("go.colony", robot="round")) == ["E104"]
    (project / "main.colony").write_text('import robot\nimport "go.colony"\n')
    assert robot_of(load_file("main.colony", robot="round")) == "round"


def test_a_description_imports_on(project: Path) -> None:
    (project / "robots" / "better.colony").write_text('import "amr.colony"\nparam better = 2\n')
    assert robot_of(load_text(GO + "let a = better", robot="better")) == "amr"


def test_a_robot_may_have_a_folder_of_its_own(project: Path) -> None:
    (project / "robots" / "amr").mkdir()
    (project / "robots" / "amr" / "amr.colony").write_text(description("amr", 700))
    (project / "robots" / "amr" / "parts.colony").write_text("param parts = 3\n")
    for text in ("amr", "robots/amr", "robots/amr/amr.colony", str(project / "robots" / "amr")):
        program = load_file("go.colony", robot=text)
        assert [path for path, _ in program.files] == ["robots/amr/amr.colony", "go.colony"]
    assert message(check_file("go.colony"))[1] == (
        'give --robot NAME, or write `robot = "NAME"` in colony.toml; '
        "robots that come with colony: amr, create2, omni, pioneer, rome, turtlebot; in `robots`: amr, cart"
    )
    (project / "robots" / "rome").mkdir()  # without a description: that of colony is used
    assert robot_of(load_file("go.colony", robot="rome")) == "rome"


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_robots_of_colony(path: Path) -> None:
    program = load_text(GO, robot=path.stem)
    assert program.robot == load_file(path).robot
    assert load_file(path, robot=path.stem).limits == program.limits


# --- files


def test_files_of_a_program_have_the_description_where_it_is(project: Path) -> None:
    assert [path for path, _ in load_file("deep/er/go.colony", robot="amr").files] == [
        "robots/amr.colony",
        "deep/er/go.colony",
    ]
    assert [path for path, _ in load_file("go.colony", robot="rome").files] == [
        "colony.shipped/functions.colony",
        "colony.shipped/rome.colony",
        "go.colony",
    ]
    (project / "main.colony").write_text('import "go.colony" as go\nimport "robots/amr.colony"\n')
    paths = [path for path, _ in load_file("main.colony").files]
    assert sorted(paths) == ["go.colony", "main.colony", "robots/amr.colony"]


# --- errors


def message(checked: Checked) -> tuple[str, str | None]:
    [found] = [d for d in checked.diagnostics if d.severity == "error"]
    assert found.span.text == "import robot"
    return found.message, found.hint


def test_no_robot_is_chosen(project: Path) -> None:
    lists = (
        "robots that come with colony: amr, create2, omni, pioneer, rome, turtlebot; in `robots`: amr, cart"
    )
    how = 'give --robot NAME, or write `robot = "NAME"` in colony.toml'
    assert message(check_file("go.colony")) == ("no robot is chosen for this program", f"{how}; {lists}")
    assert message(check_text(GO))[1] == f"give `robot=`; {lists}"
    named = RobotChoice(text="lab", origin="--robot lab", is_name=True)
    hint = f"`lab` is no description: give --robot lab=DESCRIPTION; {lists}"
    assert message(check_file("go.colony", robot=named))[1] == hint


def test_an_unknown_description(project: Path) -> None:
    found = message(check_file("go.colony", robot="carts"))
    assert found == (
        "unknown description `carts`, which `robot='carts'` names",
        "did you mean `cart`?",
    )
    (project / "colony.toml").write_text('robot = "robots/carts"\n')
    assert message(check_file("deep/er/go.colony"))[0] == (
        "there is no description `robots/carts`, which `colony.toml` names"
    )


def test_a_file_without_a_robot(project: Path) -> None:
    (project / "robots" / "none.colony").write_text("param a = 3\n")
    assert message(check_file("go.colony", robot="none"))[0] == "`robots/none.colony` declares no robot"
    os.symlink(project / "nowhere", project / "robots" / "lost.colony")
    assert codes(check_file("go.colony", robot="lost")) == ["E321"]
    (project / "robots" / "bad.colony").write_text("robot bad { sensor }\n")
    assert codes(check_file("go.colony", robot="bad")) == ["E005"]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("robot = 3", "`robot` in `colony.toml` is 3; expected the name or path of a description"),
        ('robot = ""', "`robot` in `colony.toml` is ''; expected the name or path of a description"),
        ("robot = amr", "`colony.toml` is not TOML: "),
    ],
)
def test_a_project_file_that_cannot_be_used(project: Path, text: str, found: str) -> None:
    (project / "colony.toml").write_text(text)
    checked = check_file("go.colony")
    assert codes(checked) == ["E323"]
    assert message(checked)[0].startswith(found)
    assert message(checked)[1] == 'write `robot = "NAME"` there, or give --robot NAME'


@pytest.mark.parametrize("text", ["robot = 3", "robot = amr"])
@pytest.mark.parametrize("file", ["colony.toml", "pyproject.toml"])
def test_a_project_file_that_cannot_be_used_decides_nothing_beside_a_choice(
    project: Path, file: str, text: str
) -> None:
    (project / file).write_text(text if file == "colony.toml" else f"[tool.colony]\n{text}")
    assert robot_of(check_file("deep/er/go.colony", robot="amr").program) == "amr"
    assert robot_of(check_file(str(ROOT / "behaviors" / "wander.colony"), robot="rome").program) == "rome"
    assert codes(check_file(str(ROOT / "behaviors" / "wander.colony"))) == ["E323"]
    assert codes(check_file("go.colony", robot="am")) == ["E321"]
    running = RobotChoice(text="lab", origin="--robot lab", is_name=True)
    [found] = check_file("go.colony", robot=running).diagnostics
    assert (found.code, found.hint) == (
        "E323",
        'write `robot = "NAME"` there, or give --robot lab=DESCRIPTION',
    )


def test_a_project_file_may_begin_with_a_byte_order_mark(project: Path) -> None:
    (project / "colony.toml").write_text('robot = "amr"', encoding="utf-8-sig")
    assert robot_of(load_file("go.colony")) == "amr"


def test_a_project_file_that_is_a_pipe_or_huge_is_refused(project: Path) -> None:
    os.mkfifo(project / "colony.toml")
    assert codes(check_file("go.colony")) == ["E323"]
    os.unlink(project / "colony.toml")
    (project / "colony.toml").write_bytes(b"#" * 2_000_000)
    assert codes(check_file("go.colony")) == ["E323"]


def test_programs_without_import_robot_need_no_project(project: Path) -> None:
    (project / "colony.toml").write_text("robot = 3")
    assert robot_of(load_file("robots/amr.colony")) == "amr"


def test_without_import_robot_a_choice_is_not_enough(project: Path) -> None:
    assert "E301" in codes(check_text("let a = 3", robot="amr"))


# --- text


@pytest.mark.parametrize(
    "text", ["import robot as r", "import robots", "import robot.amr", 'import "a" robot']
)
def test_invalid_imports(text: str) -> None:
    assert parse(Source("t", f"{text}\n")).diagnostics


def test_it_is_printed_as_it_is_read() -> None:
    tree = parse(Source("go", GO)).file
    again = parse(Source("again", print_file(tree))).file
    assert print_file(again) == print_file(tree)
    assert "import robot\n" in print_file(tree)


def test_behaviors_in_the_repository_have_their_robot() -> None:
    assert robot_of(load_file(ROOT / "behaviors" / "wander.colony")) == "rome"


def test_what_a_robot_lacks_is_said_once(project: Path) -> None:
    (project / "go.colony").write_text(
        GO + 'let a = wide\nlet b = bumper or wide\ntest "t" { at 0 s given bumper = true expect b }\n'
    )
    found = check_file("go.colony", robot=RobotChoice(text="amr", origin="--robot amr"))
    assert [(d.code, d.span.text) for d in found.diagnostics if d.severity == "error"] == [
        ("E101", "wide"),
        ("E101", "bumper"),
    ]
    hint = next(d.hint for d in found.diagnostics if d.code == "E101")
    assert hint == f"the robot `amr` ({Path('robots/amr.colony')}) has none, neither sensor nor `let`"
