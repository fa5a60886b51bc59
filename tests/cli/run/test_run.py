"""`colony run` from end to end."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.cli.machine import MAP, Machine, Started, failed
from tests.sampling import long
from tests.waiting import until

ROAM = """
robot rome {
  sensor   sonar[24] : mm    range 0 .. 10000  from PServer.sonar     within 300 ms
  sensor   bumper    : bool                    from RServer.bumper
  sensor   chance    : number                  from Runtime.random
  sensor   docked    : number    default 0     from DServer.DockedAt
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive   idle drive(velocity = 0, turn = 0)
}
module cruise   { when true do drive(velocity = 500 mm/s, turn = 0) }
module avoid    { when min(sonar[9..15]) < 900 mm  do drive(velocity = 60 mm/s, turn = 60 deg/s) }
module stagger  { when recently(chance < 0.02, 300 ms) do drive(velocity = 200 mm/s, turn = -30 deg/s) }
module docked_m { when docked > 0 }
network { drive = docked_m inhibits (avoid suppresses stagger suppresses cruise) }
contract slow_near_walls: min(sonar[9..15]) < 900 mm implies drive.velocity <= 100 mm/s
"""


@pytest.fixture
def behavior(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A behavior that roams, in the present directory."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "roam.colony"
    path.write_text(ROAM)
    return path


def test_a_run_ends_with_a_summary_and_a_picture(colony: Colony, behavior: Path) -> None:
    result = colony("run", behavior, "--map", MAP, "--seed", "3")
    assert result.code == 0
    assert "rome: 60.0 s, 1200 frames, seed 3" in result.out
    assert "1 contract held in every frame" in result.out
    assert "wrote run.png" in result.out
    assert [line.split(":")[0] for line in result.err.splitlines()] == [f"{10 * n} %" for n in range(1, 10)]
    assert (behavior.parent / "run.png").read_bytes().startswith(b"\x89PNG")


def test_the_same_seed_gives_the_same_recording(colony: Colony, behavior: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        arguments = ("--map", MAP, "--no-picture", "--duration", "2", "--seed", str(seed), "--record", name)
        assert colony("run", behavior, *arguments).code == 0
    a, b, c = (Path(name).read_bytes() for name in "abc")
    assert a == b
    assert a != c
    assert len(a.splitlines()) == 40


def test_a_recording_is_input_of_trace(colony: Colony, behavior: Path) -> None:
    arguments = ("--map", MAP, "--no-picture", "--duration", "5s", "--record", "run.jsonl")
    assert colony("run", behavior, *arguments).code == 0
    recorded = [json.loads(line) for line in Path("run.jsonl").read_text().splitlines()]
    for backend in ("network", "clients"):
        traced = colony("trace", behavior, "--input", "run.jsonl", "--backend", backend)
        rows = [json.loads(line) for line in traced.out.splitlines()]
        assert [row["t"] for row in rows] == [row["t"] for row in recorded]
        assert [row["drive"] for row in rows] == [row["drive"] for row in recorded]
    assert {row["drive"]["by"] for row in recorded} >= {"cruise", "stagger"}


def test_json(colony: Colony, behavior: Path) -> None:
    out = colony.output(
        "run", behavior, "--map", MAP, "--format", "json", "--duration", "5", "--picture", "way.svg"
    )
    row = json.loads(out)
    assert row["frames"] == 100
    assert row["picture"] == "way.svg"
    assert row["recording"] is None
    assert sum(share["frames"] for share in row["actuators"][0]["shares"]) == 100
    assert 0 < row["distance_mm"] < 2500
    assert Path("way.svg").read_text().lstrip().startswith("<?xml")


def test_a_variable_can_be_held(colony: Colony, behavior: Path) -> None:
    result = colony("run", behavior, "--map", MAP, "--no-picture", "--duration", "2", "--set", "DockedAt=1")
    assert "(nobody)     2.00 s  100.0 %" in result.out


def test_a_broken_contract_is_exit_code_1(colony: Colony, behavior: Path) -> None:
    behavior.write_text(ROAM + "contract crawls: drive.velocity <= 10 mm/s\n")
    result = colony("run", behavior, "--map", MAP, "--no-picture", "--duration", "2")
    assert result.code == 1
    assert "contract crawls: BROKEN in 40 frames, first at 0 s, last at 1.95 s" in result.out


def test_errors_in_the_program_are_located_and_exit_code_1(colony: Colony, behavior: Path) -> None:
    behavior.write_text(ROAM.replace("PServer.sonar", "PServer.sonor"))
    err = colony.refusal("run", behavior, "--map", MAP, "--record", "run.jsonl", code=1)
    assert "roam.colony:3:12: error[R002]: `sonar`: PServer has no field `sonor`" in err
    assert "did you mean `sonar`?" in err
    assert not Path("run.jsonl").exists()


MISUSE = [
    (("--duration", "soon"), "error: --duration: found `soon`"),
    (("--set", "Docked=1"), "error: --set: no sensor reads `Docked`; did you mean `docked`?"),
    (("--seed", "-1"), "error: Invalid value for '--seed'"),
    (("--picture", "way.gif"), "error: --picture: cannot draw into `way.gif`"),
    (("--picture", "no/way.png"), "no/way.png: error: cannot write"),
    (("--record", "no/run.jsonl"), "no/run.jsonl: error: cannot write"),
    (("--record", "."), ".: error: cannot write: Is a directory"),
    (("--record", "roam.colony"), "roam.colony: error: cannot write: it is an input"),
    (("--map", "nowhere.stickrep"), "nowhere.stickrep:1:1: error[M001]"),
    (("--map", "roam.colony"), "roam.colony:2:1: error[M003]"),
]


@pytest.mark.parametrize(("arguments", "text"), MISUSE)
def test_misuse_is_one_line_and_exit_code_2(
    colony: Colony, behavior: Path, arguments: tuple[str, ...], text: str
) -> None:
    assert text in colony.one_line("run", "roam.colony", "--map", MAP, *arguments)
    assert behavior.read_text() == ROAM


def test_a_missing_file_is_misuse(colony: Colony) -> None:
    result = colony("run", "room.colony", "--map", MAP)
    assert (result.code, len(result.err.splitlines())) == (2, 1)
    assert "room.colony:1:1: error[E001]" in result.err


def test_a_full_disk_is_said_in_one_line(colony: Colony, behavior: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    result = colony("run", behavior, "--map", MAP, "--record", "/dev/full", "--no-picture")
    assert (result.code, result.err) == (2, "/dev/full: error: cannot write: No space left on device\n")


def recording(machine: Machine, behavior: Path) -> Started:
    """A run at wall-clock speed that has recorded a few frames."""
    run = machine.start("run", str(behavior), "--map", MAP, "--realtime", "--record", "run.jsonl")
    record = run.folder / "run.jsonl"
    until(lambda: failed(run) or (record.exists() and record.read_bytes().count(b"\n") >= 3), "it records")
    return run


@pytest.mark.parametrize("number", [signal.SIGINT, long(signal.SIGTERM)])
def test_an_interrupted_run_closes_the_recording_and_tells_what_was_run(
    machine: Machine, behavior: Path, number: int
) -> None:
    run = recording(machine, behavior)
    run.tell(number)
    assert run.wait() == 130
    rows = [json.loads(frame) for frame in (run.folder / "run.jsonl").read_text().splitlines()]
    assert f"{len(rows)} frames, seed 0, interrupted" in run.out
    assert all("drive" in row for row in rows)
    assert "wrote run.png" in run.out


def test_a_killed_run_leaves_whole_lines(machine: Machine, behavior: Path) -> None:
    run = recording(machine, behavior)
    run.tell(signal.SIGKILL)
    run.process.wait()
    data = (run.folder / "run.jsonl").read_bytes()
    assert data.endswith(b"\n")
    assert [json.loads(line)["t"] for line in data.splitlines()][:3] == [0.0, 0.05, 0.1]
