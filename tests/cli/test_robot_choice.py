"""`--robot NAME[=DESCRIPTION]`: every command that reads behaviors takes it, in the same way."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.cli.machine import MAP, Machine
from tests.waiting import until

GO = """language 1
import robot
module go { when not bumper do drive(velocity = 100 mm/s, turn = 0) }
network { drive = go }
contract slow: drive.velocity <= 100 mm/s
test "goes" { at 0 s given bumper = false expect drive by go }
"""

SMALL = """language 1
robot small {
  sensor bumper : bool from RServer.bumper within 200 ms
  actuator drive { velocity : mm/s range -200 .. 200, turn : deg/s }
           to RServer.drive idle drive(velocity = 0, turn = 0)
}
let battery = 1
"""
BARE = SMALL.replace("  sensor bumper : bool from RServer.bumper within 200 ms\n", "").replace(
    "small", "bare"
)


@pytest.fixture
def go(colony: Colony, tmp_path: Path) -> str:
    """A behavior with `import robot`, in a project with robots of its own."""
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "small.colony").write_text(SMALL)
    (tmp_path / "robots" / "bare.colony").write_text(BARE)
    (tmp_path / "go.colony").write_text(GO)
    return "go.colony"


ROW = json.dumps({"t": 0, "bumper": False})
COMMANDS = [
    ("check", "FILE"),
    ("test", "FILE"),
    ("verify", "FILE"),
    ("compile", "FILE"),
    ("compile", "FILE", "-o", "go.colonyc"),
    ("trace", "FILE", "--input", "-"),
    ("diff", "FILE", "FILE"),
    ("graph", "FILE"),
    ("run", "FILE", "--map", MAP, "--duration", "0.2", "--no-picture"),
]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_command_takes_it(colony: Colony, go: str, tmp_path: Path, command: tuple[str, ...]) -> None:
    arguments = [go if a == "FILE" else a for a in command]
    unbound = colony(*arguments, stdin=ROW)
    assert unbound.code in (1, 2)
    assert "error[E320]" in unbound.err
    for robot in ("small", "lab=small", "lab=robots/small.colony"):
        assert colony(*arguments, "--robot", robot, stdin=ROW).code == 0
    (tmp_path / "colony.toml").write_text('robot = "small"\n')
    assert colony(*arguments, stdin=ROW).code == 0


@pytest.mark.parametrize("name", sorted({command[0] for command in COMMANDS} | {"audit", "serve"}))
def test_help_says_it(colony: Colony, name: str) -> None:
    assert "--robot NAME[=DESCRIPTION]" in colony(name, "--help").out


@pytest.mark.parametrize("text", ["", "=", "lab=", "=small"])
def test_invalid_choices(colony: Colony, go: str, text: str) -> None:
    for command in (("test", go), ("check", go), ("run", go, "--map", MAP)):
        err = colony.refusal(*command, "--robot", text)
        is_name = command[0] == "run" and text != "lab="
        assert ("cannot be the name of a robot" if is_name else "expected NAME[=DESCRIPTION]") in err


def test_an_unknown_name(colony: Colony, go: str) -> None:
    assert "hint: did you mean `small`?" in colony.refusal("test", go, "--robot", "smal", code=1)
    err = colony.refusal("run", go, "--map", MAP, "--robot", "lab", code=1)
    assert "`lab` is no description: give --robot lab=DESCRIPTION" in err


def test_check_tells_of_which_robot_a_finding_is(colony: Colony, go: str) -> None:
    both = ("--robot", "small", "--robot", "bare")
    err = colony.refusal("check", go, *both, code=1)
    assert "error[E101]: `bare`: unknown name `bumper`" in err
    assert "note[N003]: `small`: `small` has no body" in err
    assert err.count("small.colony:") == 1  # and nothing else is about it
    assert colony("check", go, "--robot", "small", "--robot", "rome").out == f"{go}: ok\n"
    Path(go).write_text(GO + "let a = nobody\n")
    _, out, _ = colony("check", go, *both, "--format", "json")
    messages = sorted(d["message"] for d in json.loads(out) if d["code"] == "E101")
    assert messages == ["`bare`: unknown name `bumper`", "unknown name `nobody`"]


def test_a_program_with_its_own_robot_is_checked_as_ever(colony: Colony, go: str) -> None:
    Path("own.colony").write_text(SMALL)
    code, out, err = colony("check", "own.colony")
    assert (code, out) == (0, "own.colony: ok\n")
    assert [line for line in err.splitlines() if "[" in line] == [err.splitlines()[0]]
    assert "note[N003]: `small` has no body" in err
    err = colony("check", "own.colony", "--robot", "rome").err
    assert "error[E322]: the program has its own robot, `small`: --robot rome cannot give it another" in err
    assert colony("check", "robots/small.colony", "--robot", "small").code == 0


def test_diff_ignores_how_the_robot_came_in(colony: Colony, go: str) -> None:
    Path("by_path.colony").write_text(GO.replace("import robot", 'import "robots/small.colony"'))
    assert "DIFFERENT" not in colony.output("diff", go, "by_path.colony", "--robot", "small")


def test_a_compiled_program_runs_without_its_robot(colony: Colony, go: str) -> None:
    assert colony("compile", go, "--robot", "small", "-o", "go.colonyc").code == 0
    Path("robots/small.colony").unlink()
    run = ("run", "go.colonyc", "--map", MAP, "--duration", "0.2", "--no-picture")
    assert colony(*run).out.startswith("small: 0.2 s")
    assert colony(*run, "--robot", "lab7").out.startswith("lab7: 0.2 s")
    err = colony.refusal(*run, "--robot", "lab7=rome")
    assert "compiled with the description of its robot; give --robot NAME alone" in err


def test_a_served_robot_refuses_a_program_for_another(machine: Machine, colony: Colony, go: str) -> None:
    folder = str(Path.cwd() / "robots")
    for server in ("Clock", "RServer"):
        machine.start("serve", server, "--robot", f"rome={folder}/small.colony")
    until(lambda: {"Clock", "RServer"} <= set(machine.directory.running()), "both servers run")
    Path("robots/wide.colony").write_text(SMALL.replace("-200 .. 200", "-300 .. 300"))
    err = colony.refusal("drive", go, "--duration", "0.3", "--robot", f"rome={folder}/wide.colony", code=1)
    assert "interface (`small`) than the robot's (`small`): `drive` differs (field `velocity`)" in err


def test_a_robot_cannot_be_served_with_an_unknown_description(colony: Colony, go: str) -> None:
    err = colony.refusal("serve", "RServer", "--robot", "lab=nobody", code=1)
    assert "error[E321]: unknown description `nobody`" in err


@pytest.mark.parametrize("command", ["test", "verify", "graph", "run"])
def test_only_check_takes_several_robots(colony: Colony, command: str) -> None:
    err = colony.refusal(command, "wander", "--robot", "nobody", "--robot", "rome")
    assert "given 2 times, but this is for one robot" in " ".join(err.split())
