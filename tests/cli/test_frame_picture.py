"""Pictures of frames: of recordings by `colony trace`, of tests by `colony test`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from colony.cli.frame_picture import decision_lines
from colony.dsl.load import load_text
from colony.ir.frame import Frame, Outcome
from colony.ir.program import Program
from colony.verify.reference.interpreter import Interpreter
from tests.cli.conftest import Colony
from tests.paths import ROOT

BEHAVIOR = """language 1
robot r {
  sensor scan[5] : m bearing -60 deg step 30 deg range 0 .. 8 from PServer.scan
  actuator drive { velocity : mm/s } to RServer.drive idle drive(velocity = 0)
}
module stop { when min(scan) < 500 mm do drive(velocity = 0) }
module go   { when true do drive(velocity = 200 mm/s) }
network { drive = stop suppresses go }
test "stops" {
  at 0 s    given scan = 3 m               expect drive by go
  at 500 ms given scan[0 deg] = 600 mm     expect drive by stop
  at 1 s    given scan[0 deg] = 400 mm     expect drive by stop
}
test "goes" { at 0 s given scan = 1 m      expect drive by go }
"""
FRAMES = "\n".join(json.dumps({"t": i / 10, "scan": [1, 1, 1 - i / 10, 1, 1]}) for i in range(8))

Drawn = list[tuple[str, Frame, Outcome, Sequence[str] | None]]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "scanner.colony"
    path.write_text(BEHAVIOR)
    return path


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Drawn:
    """What is drawn, without pixels."""
    found: Drawn = []

    def draw(
        _: Path, __: Program, title: str, frame: Frame, outcome: Outcome, active: Sequence[str] | None
    ) -> None:
        found.append((title, frame, outcome, active))

    monkeypatch.setattr("colony.cli.trace.draw_frame", draw)
    monkeypatch.setattr("colony.cli.frame_picture.draw_frame", draw)
    return found


@pytest.mark.parametrize(("name", "start"), [("scan.png", b"\x89PNG"), ("scan.svg", b"<?xml")])
def test_a_frame_is_drawn(colony: Colony, file: Path, tmp_path: Path, name: str, start: bytes) -> None:
    ran = colony("trace", file, "--input", "-", "--frame", "6", "--picture", name, stdin=FRAMES)
    assert ran.code == 0
    assert [json.loads(line)["t"] for line in ran.out.splitlines()] == [0.6]
    assert ran.err == f"drawn in {name}: scanner.colony, frame 6 at 0.6 s\n"
    assert (tmp_path / name).read_bytes().startswith(start)


def test_the_last_frame_is_drawn_where_none_is_chosen(colony: Colony, file: Path, drawn: Drawn) -> None:
    ran = colony("trace", file, "--input", "-", "--picture", "scan.png", stdin=FRAMES)
    assert len(ran.out.splitlines()) == 8
    [(title, frame, outcome, active)] = drawn
    assert (title, frame.t_ns) == ("scanner.colony, frame 7 at 0.7 s", 700_000_000)
    assert (outcome.commands["drive"].by, active) == ("stop", ("stop", "go"))


@pytest.mark.parametrize("backend", ["clients", "python"])
def test_only_the_interpreter_knows_who_was_active(
    colony: Colony, file: Path, drawn: Drawn, backend: str
) -> None:
    colony("trace", file, "--input", "-", "--backend", backend, "--picture", "s.png", stdin=FRAMES)
    [(_, _, outcome, active)] = drawn
    assert (outcome.commands["drive"].by, active) == ("stop", None)


def test_frames_have_the_numbers_of_the_recording(colony: Colony, file: Path) -> None:
    rows = [{"t": i, "@semantics": 4, "@tick": 10 + i, "scan": [1] * 5} for i in range(3)]
    stdin = "\n".join(map(json.dumps, rows))
    ran = colony("trace", file, "--input", "-", "--frame", "12", stdin=stdin)
    assert (ran.code, json.loads(ran.out)["t"]) == (0, 2.0)
    err = colony.refusal("trace", file, "--input", "-", "--frame", "2", stdin=stdin)
    assert err == "<stdin>: error: --frame: found no frame 2; it has frames 10 to 12\n"
    ran = colony("trace", file, "--input", "-", "--frame", "2")
    assert ran.err == "<stdin>: error: --frame: found no frame 2; it has no frame\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--picture", "scan.pdf"], "--picture: cannot draw into `scan.pdf`; expected a file ending in .png"),
        (["--picture", "gone/scan.png"], "gone/scan.png: error: cannot write: the folder does not exist"),
        (["--frame", "-1"], "-1 is not in the range x>=0"),
    ],
)
def test_what_cannot_be_drawn_is_refused(colony: Colony, file: Path, arguments: list[str], said: str) -> None:
    assert said in colony.refusal("trace", file, "--input", "-", *arguments, stdin=FRAMES)


def test_a_program_without_bearings_is_refused(colony: Colony, file: Path) -> None:
    file.write_text(BEHAVIOR.replace("bearing -60 deg step 30 deg", "").replace("[0 deg]", "[2]"))
    expected = "error: --picture: found no sensor with bearings"
    assert expected in colony.refusal("trace", file, "--input", "-", "--picture", "scan.png", stdin=FRAMES)
    code, _, err = colony("test", file, "--only", "goes", "--picture", "scan.png")
    assert (code, expected in err) == (2, True)


def test_without_frames_there_is_nothing_to_draw(colony: Colony, file: Path) -> None:
    ran = colony("trace", file, "--input", "-", "--picture", "scan.png")
    assert (ran.code, ran.err) == (1, "<stdin>: error: --picture: found no frame that is decided\n")


def test_decisions_are_lines() -> None:
    program = load_text(BEHAVIOR + "contract forward: drive.velocity > 0")
    interpreter = Interpreter(program)
    outcome = interpreter.step(Frame(0, {"scan": [0.1] * 5}))
    assert list(decision_lines(program, outcome, interpreter.active_modules())) == [
        "drive by stop: velocity = 0 mm/s",
        "active: stop, go",
        "broken: forward",
    ]
    assert list(decision_lines(program, outcome, ()))[1] == "active: no module"
    assert len(list(decision_lines(program, outcome, None))) == 2


# --- the program of the recording ------------------------------------------------------------------


def test_a_recording_knows_its_bearings(colony: Colony, drawn: Drawn) -> None:
    map_ = ROOT / "maps" / "loop.stickrep"
    colony("run", "wander", "--map", map_, "--no-picture", "--duration", "0.5", "--record", "run.mcap")
    out = colony.output("trace", "--input", "run.mcap", "--frame", "4", "--picture", "scan.png")
    [(title, frame, _, _)] = drawn
    assert title == "wander.colony, frame 4 at 0.2 s"
    assert "sonar" in frame.readings
    assert out == colony("trace", "wander", "--input", "run.mcap", "--frame", "4").out


def test_json_lines_have_no_program(colony: Colony) -> None:
    err = colony.refusal("trace", "--input", "-", stdin=FRAMES)
    assert "error[A005]: a recording as JSON lines does not contain its program" in err
    assert "give the behavior that was run as FILE" in err


# --- tests -----------------------------------------------------------------------------------------


def test_a_test_is_drawn_where_it_fails(colony: Colony, file: Path, drawn: Drawn) -> None:
    ran = colony("test", file, "--only", "stops", "--picture", "scan.png")
    assert (ran.code, "FAILED: stops" in ran.out) == (1, True)
    [(title, frame, outcome, active)] = drawn
    assert title == "stops, frame 1 at 0.5 s"
    assert frame.readings["scan"] == (3.0, 3.0, 0.6, 3.0, 3.0)
    assert (outcome.commands["drive"].by, active) == ("go", ("go",))


def test_another_frame_of_a_test_may_be_chosen(colony: Colony, file: Path, drawn: Drawn) -> None:
    assert colony("test", file, "--only", "stops", "--picture", "scan.png", "--frame", "2").code == 1
    assert colony("test", file, "--only", "goes", "--picture", "scan.png").code == 0
    assert [title for title, *_ in drawn] == ["stops, frame 2 at 1 s", "goes, frame 0 at 0 s"]
    code, _, err = colony("test", file, "--only", "goes", "--picture", "scan.png", "--frame", "1")
    assert code == 2
    assert err == f'{file}: "goes": error: --frame: found no frame 1; it has frames 0 to 0\n'


def test_one_test_is_drawn(colony: Colony, file: Path) -> None:
    ran = colony("test", file, "--picture", "scan.png")
    assert (ran.code, "1 passed, 1 failed" in ran.out) == (2, True)
    assert f"{file}: error: --picture: found 2 tests; expected one: choose it with --only NAME" in ran.err
    Path("none.colony").write_text(file.read_text().partition("\ntest ")[0])
    ran = colony("test", "none.colony", "--picture", "scan.png")
    assert (ran.code, "error: --picture: the file has no tests" in ran.err) == (2, True)
    err = colony.refusal("test", file, file, "--picture", "scan.png")
    assert "--picture draws a frame of one test; found 2 files" in err
    assert "--frame chooses the frame that --picture draws" in colony.refusal("test", file, "--frame", "2")
