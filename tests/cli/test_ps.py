"""`colony ps` shows the processes of a run that are no servers: here the one that clients share."""

from __future__ import annotations

import json
import signal

from tests.cli.conftest import Colony
from tests.cli.machine import MAP, ROBOT, WANDER, Machine, children_of, status
from tests.waiting import until


def test_the_processes_of_a_run_are_shown(machine: Machine, colony: Colony) -> None:
    run = machine.start("run", WANDER, "--map", MAP, "--processes", "--no-picture", "--duration", "1000")
    until(lambda: run.ended() or machine.truth(), "the simulator starts")
    with machine.session() as session:
        until(lambda: run.ended() or ((s := status(session)) and s.frames > 3), "the run begins")
    assert not run.ended(), run.err
    (state,) = json.loads(colony("ps", "--format", "json").out)
    processes = state["run"]["processes"]
    assert {*processes} == {"Simulator", "Clock", "RServer", "PServer", "DServer", "clients"}
    assert {*processes.values()} == {*children_of(run.pid)}
    shown = colony("ps", "--robot", ROBOT).out
    assert f"      process  id\n      clients  {processes['clients']}\n" in shown
    assert f"  Simulator  up, process {processes['Simulator']}\n" in shown
    run.tell(signal.SIGINT)
    assert run.wait() == 130
