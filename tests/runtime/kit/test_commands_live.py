"""A lift of our own, a process beside those of a robot: driven, stopped, killed, started again, audited."""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from colony.runtime.kit.connection import Session
from colony.runtime.kit.server import Reading, Server, command, field, parameter
from tests.examples.stage import Machine, Process, machine
from tests.waiting import until

PROGRAM = """
language 1

enum light { off = 0, slow = 5, fast = 9 }

robot rome {
  sensor   height : mm    from Lift.height  within 300 ms
  sensor   bumper : bool  from RServer.bumper
  actuator drive { velocity : mm/s range -300 .. 300, turn : deg/s range -45 .. 45 }
           to RServer.drive  idle drive(velocity = 0 mm/s, turn = 0 deg/s)
  actuator lift { height : cm range 0 .. 40, fast : bool }
           to Lift.move  idle lift(height = 1 cm, fast = false)
  actuator lamp { light : light }  to Lift.shine  idle hold
}
module up { when height < 20 cm or last.lift.fast  do lift(height = 40 cm, fast = true) }
module turn { when height >= 0 mm and not bumper  do drive(velocity = 0 mm/s, turn = 20 deg/s) }
module blink { when height > 10 cm  do lamp(light = light.fast) }
network { lift = up  drive = turn  lamp = blink }
limit lift.height <= 30 cm

contract low: lift.height <= 30 cm
"""


def serve() -> None:
    """The lift, until somebody ends it by a signal. It says what it does."""
    heights = [0.0]

    def move(height: float, fast: bool) -> None:
        heights[0] = height
        print(f"move {height:g} {fast}", flush=True)

    with Server.open("Lift", robot="ada") as server:
        signal.signal(signal.SIGINT, lambda *_: server.exitloop())
        height, fast = parameter("height", unit="mm", low=0.0, high=400.0), parameter("fast", boolean=True)
        light = parameter("light", members={"off": 0, "slow": 5, "fast": 9})
        server.mainloop(
            fields=[field("height", lambda: Reading(heights[0], age_ns=0), unit="mm", has_age=True)],
            commands=[
                command("move", move, height, fast, safe=lambda: print("safe", flush=True)),
                command("shine", lambda light: print(f"shine {light:g}", flush=True), light),
            ],
        )


@pytest.fixture
def rome(tmp_path: Path) -> Iterator[Machine]:
    """A machine with the servers of a simulated robot, and the program."""
    (tmp_path / "lift.colony").write_text(PROGRAM, encoding="utf-8")
    with machine(tmp_path) as on:
        on.start("colony serve all --robot ada --map loop")
        on.there("ada", "Clock", "RServer", "DServer")
        yield on


def lift_on(on: Machine) -> Process:
    started = on.start("python -m tests.runtime.kit.test_commands_live serve")
    on.there("ada", "Lift")
    return started


def says_next(lift: Process, *lines: str) -> None:
    """Wait until it has done this, after what it has done so far."""
    before = len(lift.printed())
    until(lambda: all(f"{line}\n" in lift.printed()[before:] for line in lines), f"{lines} of the lift")


UP, IDLE = "move 300 True", "move 10 False"


@pytest.mark.long
def test_a_lift_of_our_own(rome: Machine) -> None:
    lift = lift_on(rome)
    until(lambda: lift.printed() == "safe\n", "it is safe before a program drives it")
    run = rome.start("colony drive lift.colony --robot ada --record run.mcap")
    says_next(lift, UP, "shine 9")
    stop = rome.run("colony stop --robot ada")
    assert (stop.result(), "Clock, RServer, DServer, Lift" in stop.printed()) == (0, True), stop.printed()
    before = lift.printed()
    says_next(lift, IDLE)
    assert UP not in lift.printed()[len(before) :]
    assert rome.run("colony stop --robot ada --release").result() == 0
    says_next(lift, UP)
    shown = rome.run("colony ps --robot ada").printed()
    assert re.search(r"^  Lift +up, process \d+$", shown, re.MULTILINE), shown
    os.kill(lift.pid, signal.SIGSTOP)
    try:
        stop = rome.run("colony stop --robot ada")
        before = lift.printed()
    finally:
        os.kill(lift.pid, signal.SIGCONT)
    assert (stop.result(), "Lift did not acknowledge the stop" in stop.printed()) == (1, True), stop.printed()
    says_next(lift, IDLE)
    assert UP not in lift.printed()[len(before) :], "though it had not heard of the stop before it went on"
    assert rome.run("colony stop --robot ada --release").result() == 0
    says_next(lift, UP)
    lift.kill()
    lift = lift_on(rome)
    says_next(lift, UP, "shine 9")
    run.finish()
    until(lambda: lift.printed().endswith(f"{IDLE}\n"), "it is idle after the run")
    assert re.search(r"BROKEN|disagree", run.printed()) is None, run.printed()
    audit = rome.run("colony audit run.mcap")
    assert audit.result() == 0, audit.printed()
    again = rome.run("colony drive lift.colony --robot ada --duration 1")
    assert again.result() == 0, again.printed()
    assert UP in lift.printed().rpartition(IDLE)[0]
    before = lift.printed()
    with Session.open("ada", environment=rome.environment) as session:
        assert "Lift" in session.servers()
    assert lift.finish() == 0
    assert lift.printed()[len(before) :].endswith(f"{IDLE}\n"), "also in the end"
    assert "safe" not in lift.printed()[len("safe\n") :], "as it has an idle command"


if __name__ == "__main__" and sys.argv[1:] == ["serve"]:
    serve()
