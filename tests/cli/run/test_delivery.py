"""A sequence in processes: a lost sensor, an operator and killed servers hold it, and do not end it."""

from __future__ import annotations

import os
import re
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from colony.analysis.follower import Follower, Interpreters, UnknownMemory, step_given
from colony.analysis.recording import unpacked_program
from colony.ir.program import Machine as SequenceMachine
from colony.runtime.kit.connection import Session
from colony.runtime.library import robot
from colony.runtime.recordings.mcap_reader import McapReader
from colony.sim.plant.protocol import Truth
from tests.cli.machine import ROBOT, Machine, Started, audited, failed
from tests.paths import ROOT
from tests.waiting import until

pytestmark = pytest.mark.long

DELIVERY = ROOT / "behaviors" / "delivery.colony"
DRIVEN_BACK_MM = 300.0
travel = partial(until, patience_s=600.0)
"""Waits for a way of some seconds: on a busy machine the robot often stands."""


@pytest.fixture
def delivery(machine: Machine, tmp_path: Path) -> Started:
    """A delivery from the dock, with sensors at the edges of the floor that are lost for 2 s.

    On a busy machine clients are late, which counts as time of a task: all of them have time enough.
    """
    behavior = tmp_path / "delivery.colony"
    behavior.write_text(re.sub(r"within \d+ s", "within 3000 s", DELIVERY.read_text()))
    scenario = tmp_path / "lost.scenario"
    scenario.write_text("at 6 s cliff = missing\nat 8 s cliff = false\n")
    where = (
        "--robot",
        f"{ROBOT}=amr",
        "--map",
        "office",
        "--start",
        "3m,-400mm,180",
        "--scenario",
        str(scenario),
    )
    ordered = [word for name in ("Ordered", "Loaded", "Unloaded") for word in ("--set", f"{name}=true")]
    how = ("--scenario", str(scenario), "--processes", "--isolate", "--duration", "1000", "--no-picture")
    return machine.start("run", str(behavior), *where, *ordered, *how, "--record", "run.mcap")


def where(machine: Machine) -> Truth:
    return until(machine.truth, "the simulator answers")


def take_over(machine: Machine, session: Session) -> None:
    """Drive back by hand, and give the robot back."""
    begun = where(machine).x
    with session.connect("RServer", name="operator", priority=50) as base:

        def is_back() -> bool:
            base.do(robot.drive(-200.0, 0.0, lease=1.0))
            return abs(where(machine).x - begun) > DRIVEN_BACK_MM

        until(is_back, "the operator drives back")


def kill(machine: Machine, server: str) -> None:
    pid = until(lambda: machine.pid(server), f"{server} is there")
    os.kill(pid, signal.SIGKILL)
    until(lambda: machine.pid(server) not in (None, pid), f"{server} is started again")


def phases_of(recording: Path) -> list[str]:
    """Return the phases of the sequence in a recorded run, in order."""
    phases: list[str] = []
    with recording.open("rb") as file:
        reader = McapReader(file, recording.name)
        with unpacked_program(reader.run.program, reader.run.sources, None, ROBOT) as program:
            (sequence,) = (d for d in program.derived if isinstance(d, SequenceMachine) and d.tasks)
            names = {number: name for name, number in sequence.type.members}
            follower = Follower(Interpreters(program))
            for frame in reader.frames(program):
                interpreter = follower.feed(frame)
                if not isinstance(interpreter, UnknownMemory):
                    step_given(interpreter, frame)
                    phase = names[float(interpreter.states[sequence.name])]  # type: ignore[arg-type]
                    phases += [phase] if phases[-1:] != [phase] else []
    return phases


def test_a_delivery_survives_a_lost_sensor_an_operator_and_killed_servers(
    machine: Machine, delivery: Started
) -> None:
    until(lambda: failed(delivery) or machine.moves(), "it leaves the dock")
    with machine.session() as session:
        travel(lambda: failed(delivery) or where(machine).x > 5_000.0, "it is on its way")
        take_over(machine, session)
        travel(lambda: failed(delivery) or where(machine).x > 7_000.0, "it goes on")
        kill(machine, "Lidar")
        travel(lambda: failed(delivery) or where(machine).x > 8_700.0, "it is at the store")
        travel(lambda: failed(delivery) or where(machine).x < 8_000.0, "it has its load")
        kill(machine, "RServer")
        kill(machine, "DServer")
        travel(lambda: failed(delivery) or where(machine).x < 3_300.0, "it is at the dock again")
        until(machine.stands, "it is over")
        time.sleep(1.0)  # what is recorded is flushed within a second
    assert delivery.interrupt() == 130, delivery.err
    assert audited(machine, delivery)
    phases = phases_of(delivery.folder / "run.mcap")
    order = ["leave_dock", "to_store", "load_up", "to_desk", "set_down", "to_dock", "done"]
    assert phases == order
