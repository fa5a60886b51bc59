"""What a module in Python does to its own process is a lost client, and nothing else: real processes."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from colony.runtime.library.leader import RunStatus
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, Machine, Started, children_of, failed, lives, status
from tests.sampling import sampled
from tests.waiting import until

SERVERS = ("Clock", "RServer", "PServer", "DServer", "Simulator")

PROGRAM = """
robot rome {
  sensor   bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s }
           to RServer.drive idle drive(velocity = 0, turn = 0)
  actuator note { value : number } to DServer.Note idle note(value = 0)
}
module rogue from python "rogue:Rogue" { reads bumper  commands note }
module rests { when true do note(value = 1) }
module turns { when true do drive(velocity = 0, turn = 20 deg/s) }
network { drive = turns  note = rogue suppresses rests }
contract turning: drive is idle or drive.turn == 20 deg/s
"""

ROGUE = """
import os, pathlib, signal
FORKED = pathlib.Path(__file__).with_name("forked")
class Rogue:
    def __init__(self):
        self.steps = 0
    def step(self, frame):
        self.steps += 1
        done = pathlib.Path(__file__).with_name("done")
        if self.steps == 20 and not done.exists():
            done.touch()
            CRIME
        return {"value": float(self.steps)} if self.steps % 3 else None
"""

CRIMES = {
    "hangs": "while True: pass",
    "forks": "FORKED.write_text(str(pid)) if (pid := os.fork()) else [signal.pause() for _ in iter(int, 1)]",
    "exits": "os._exit(0)",
    "aborts": "os.abort()",
    "raises": "raise SystemExit('enough')",
    "takes a gigabyte": "self.much = b'x' * (1 << 30)",
    "prints": "print('x' * (1 << 24))",
    "ends its group": "os.killpg(0, signal.SIGKILL)",
}
FATAL = {"exits", "aborts", "raises", "ends its group"}


def standing_of(run: RunStatus, address: str) -> str:
    return next(client.standing for client in run.clients if client.address == address)


@pytest.mark.long
@pytest.mark.parametrize("crime", sampled(tuple(CRIMES), every=len(CRIMES), thorough=True))
def test_nothing_else_is_harmed(machine: Machine, colony: Colony, tmp_path: Path, crime: str) -> None:
    (tmp_path / "rogue.py").write_text(ROGUE.replace("CRIME", CRIMES[crime]))
    (tmp_path / "r.colony").write_text(PROGRAM)
    options = ("--map", MAP, "--processes", "--no-picture", "--record", "run.mcap", "--format", "json")
    run = machine.start("run", str(tmp_path / "r.colony"), *options, "--duration", "1000")
    until(lambda: failed(run) or (tmp_path / "done").exists(), "the module misbehaves")
    with machine.session() as session:

        def standing() -> RunStatus:
            return until(lambda: status(session), "the leader answers")

        servers = {name: machine.pid(name) for name in SERVERS}
        if crime == "hangs":
            until(lambda: standing_of(standing(), "note/rogue") == "lost", "its client is lost")
        since = standing()
        until(lambda: standing().frames > since.frames + 40, "frames go on")
        if crime != "hangs":
            until(lambda: standing_of(standing(), "note/rogue") == "alive", "its client is back")
        found = standing()
        assert found.commanded_by["drive"] == "turns"
        assert {name: machine.pid(name) for name in SERVERS} == servers
        assert [client.restarts for client in found.clients] == [0] * len(found.clients)
        assert standing_of(found, "drive/turns") == "alive"
        processes = children_of(run.pid)
        run.tell(signal.SIGINT)
    assert run.wait() == 130, run.err
    assert not any(map(lives, processes))
    if crime == "forks":
        until(lambda: not lives(int((tmp_path / "forked").read_text())), "what it forked is killed")
    _check_recorded(run, colony, crime)


def _check_recorded(run: Started, colony: Colony, crime: str) -> None:
    assert ("activity/rogue" in run.err) is (crime in FATAL), run.err
    summary = json.loads(run.out)
    assert summary["disagreements"] == []
    assert summary["breaches"] == []
    result = colony("audit", run.folder / "run.mcap", "--format", "json")
    assert result.code == 0, result.out + result.err
    report = json.loads(result.out)
    assert report["agrees"] is True
    assert report["compared"] > 0
    assert report["lost"] + report["late"] > 0 if crime == "hangs" else True
    assert os.path.getsize(run.folder / "run.mcap") < 1 << 24
