from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from colony.compile.backends.c.native import is_available
from colony.ir.frame import Frame
from colony.runtime.recordings.replay import RecordingLine
from tests.cli.conftest import Colony

BACKENDS = ["network", "clients", "python", *(["c"] if is_available() else [])]


@pytest.mark.parametrize("backend", BACKENDS)
def test_decisions_as_documented(colony: Colony, behavior: Path, backend: str) -> None:
    frames = [
        {"t": 0, "near": 300, "bumper": False, "rays": [1, 2, 3]},
        {"t": 0.05, "near": 300, "bumper": True, "rays": [1, 2, 3]},
        {"t": 0.1, "rays": [1, 2, 3], "bumper": None},
        {"t": 0.2, "near": 300, "bumper": True, "rays": [1e999, 2, 3]},
    ]
    stdin = "\n".join(map(json.dumps, frames))
    out = colony.output("trace", behavior, "--input", "-", "--backend", backend, stdin=stdin)
    rows = [json.loads(line) for line in out.splitlines()]
    assert rows == [
        {"t": 0.0, "drive": {"by": "cruise", "velocity": 300.0, "turn": 0.0}, "lamp": None},
        {
            "t": 0.05,
            "drive": {"by": "back", "velocity": -100.0, "turn": 1.0},
            "lamp": {"by": "shine", "on": True},
        },
        {"t": 0.1, "drive": {"by": None, "velocity": 0.0, "turn": 0.0}, "lamp": None},
        {
            "t": 0.2,
            "drive": {"by": "back", "velocity": 0.0, "turn": 0.0, "fault": "not finite"},
            "lamp": {"by": "shine", "on": True},
        },
    ]


@pytest.mark.parametrize("backend", BACKENDS)
def test_readings_and_commands_are_in_declared_units(colony: Colony, tmp_path: Path, backend: str) -> None:
    behavior = tmp_path / "fan.colony"
    behavior.write_text("""language 1
robot cart {
  sensor battery : percent from DServer.Battery  sensor heat : degC from DServer.Heat
  sensor left : Ah from DServer.Left
  actuator fan { level : percent range 0 .. 100, draw : A } to DServer.Fan idle fan(level = 0, draw = 0)
}
module cool { when heat > 30 degC and left > 100 mA*min  do fan(level = battery / 2, draw = left / 2 min) }
network { fan = cool }
""")
    row = {"t": 0, "battery": 50, "heat": 31, "left": 0.5}
    code, out, _ = colony("trace", behavior, "--input", "-", "--backend", backend, stdin=json.dumps(row))
    assert (code, json.loads(out)["fan"]) == (0, {"by": "cool", "level": 25.0, "draw": 15.0})


def test_output_of_a_trace_can_be_input_again(colony: Colony, behavior: Path) -> None:
    row = {"t": 1.5, "near": 300, "bumper": False, "rays": [1, 2, 3]}
    row |= {"drive": {"by": "cruise", "velocity": 1.0, "turn": 0.0}}
    assert colony("trace", behavior, "--input", "-", stdin=json.dumps(row)).code == 0


@pytest.mark.parametrize("backend", BACKENDS)
def test_all_memory_begins_anew_at_a_restart(colony: Colony, behavior: Path, backend: str) -> None:
    row = {"@semantics": 4, "near": 300, "rays": [1, 2, 3]}
    bumped, after = {"t": 0, "@tick": 7, "bumper": True} | row, {"t": 0.05, "@tick": 8, "bumper": False} | row
    for last, winner in ((after, "back"), (after | {"@restart": True}, "cruise")):
        stdin = f"{json.dumps(bumped)}\n{json.dumps(last)}"
        _, out, _ = colony("trace", behavior, "--input", "-", "--backend", backend, stdin=stdin)
        assert [json.loads(line)["drive"]["by"] for line in out.splitlines()] == ["back", winner]


@pytest.mark.parametrize(
    ("line", "place", "code", "said"),
    [
        ("{", "2:2", "F001", "not JSON"),
        ("[1]", "2:1", "F002", "a frame must be a JSON object"),
        ('{"near": 3}', "2:1", "F003", "no time"),
        ('{"t": "now"}', "2:2", "F003", 'found "now"'),
        ('{"t": 1e999}', "2:2", "F003", "found Infinity"),
        ('{"t": 1' + "0" * 400 + "}", "2:2", "F003", "found Infinity"),
        ('{"t": true}', "2:2", "F003", "found true"),
        ('{"near": 3, "t": 0.5}', "2:13", "F004", "0.5 s follows 0.5 s"),
        ('{"t": 0.25}', "2:2", "F004", "time must increase"),
        ('{"t": 1, "neer": 3}', "2:10", "F005", "unknown sensor `neer` (did you mean `near`?)"),
        ('{"t": 1, "restarted": 1}', "2:10", "F009", '"restarted" must be true or false, found a number'),
        ('{"t": 1, "rays": [1, 2]}', "2:10", "F006", "`rays` must have 3 elements, found 2"),
        ('{"t": 1, "near": ' + "[" * 100_000, "2:1", "F001", "nested too deeply"),
        ('{"t": 1, "near": ' + "9" * 5000 + "}", "2:1", "F001", "too many digits"),
        ('{"t": 1, "near": 1, "near": 2}', "2:21", "F001", "`near` appears twice"),
        ('{"t": 1, "t": 2}', "2:10", "F001", "`t` appears twice"),
    ],
)
def test_bad_frames_are_one_located_line(
    colony: Colony, behavior: Path, line: str, place: str, code: str, said: str
) -> None:
    stdin = '{"t": 0.5, "near": 3}\n' + line + "\n"
    err = colony.one_line("trace", behavior, "--input", "-", stdin=stdin)
    assert err.startswith(f"<stdin>:{place}: error[{code}]: ")
    assert said in err


def test_a_bad_frame_leaves_the_output_as_it_was(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.jsonl"
    target.write_text("before")
    frames = tmp_path / "frames.jsonl"
    frames.write_bytes(b'{"t": 0}\n\xff\n')
    err = colony.refusal("trace", behavior, "--input", frames, "-o", target)
    assert err.startswith(f"{frames}:2:1: error[F007]: not UTF-8 text")
    assert target.read_text() == "before"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["b.colony", "frames.jsonl", "out.jsonl"]


def test_missing_input(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    for name in (tmp_path / "none.jsonl", tmp_path):
        err = colony.one_line("trace", behavior, "--input", name)
        assert err.startswith(f"{name}:1:1: error[F008]: cannot read the frames")


def test_a_pipe_is_read_as_standard_input_only(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in (tmp_path / "pipe", "/dev/null"):
        err = colony.refusal("trace", behavior, "--input", name)
        why = "it is not a regular file; use `--input -` for a pipe or a device"
        assert err == f"{name}:1:1: error[F008]: cannot read the frames: {why}\n"


@pytest.mark.parametrize("backend", BACKENDS)
def test_wrong_types_are_faults_and_the_sensor_is_missing(
    colony: Colony, behavior: Path, backend: str
) -> None:
    stdin = '{"t": 0, "near": "far", "bumper": 1}'
    ran = colony("trace", behavior, "--input", "-", "--backend", backend, stdin=stdin)
    assert json.loads(ran.out)["drive"]["by"] is None


def test_without_a_compiler_generated_python_decides_in_the_place_of_c(
    colony: Colony, behavior: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    ran = colony("trace", behavior, "--input", "-", "--backend", "c", stdin='{"t": 0}')
    assert ran.code == 0
    assert ran.err == "note: no C compiler (no-such-compiler): generated Python decides instead\n"
    assert ran.out == colony.output("trace", behavior, "--input", "-", stdin='{"t": 0}')


def test_times_beyond_doubles_keep_their_nanoseconds(colony: Colony, behavior: Path) -> None:
    stdin = '{"t": 1700000000.000000001}\n{"t": 1700000000.000000002}\n'
    assert '"t": 1700000000.000000002' in colony.output("trace", behavior, "--input", "-", stdin=stdin)


def test_frames_that_cannot_be_read_to_the_end(
    colony: Colony, behavior: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: object) -> Iterator[RecordingLine]:
        yield RecordingLine(1, "", Frame(0, {}), {})
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("colony.runtime.recordings.replay.Rows.__iter__", broken)
    err = colony.refusal("trace", behavior, "--input", "-")
    assert err == "<stdin>:1:1: error[F008]: cannot read the frames: Input/output error\n"


def test_standard_input_that_is_closed(behavior: Path) -> None:
    command = f"{sys.executable} -m colony.cli.main trace {behavior} --input - <&-"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "<stdin>:1:1: error[F008]: cannot read the frames: standard input is closed\n"
