"""Scenarios of runs by processes: what nobody simulates is given at its time, and withdrawn at the end."""

from __future__ import annotations

import json
from itertools import cycle, groupby, pairwise
from pathlib import Path

import pytest

from colony.cli.serve.processes import SUPERVISOR
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, ROBOT, Machine, Started, children_of, failed, lives
from tests.waiting import until

AMR = f"{ROBOT}=amr"
FRAME_S = 0.05
DURATION_S = 4.0

PRESSED = """
language 1
import robot
module cruise { when not estop and goal_number == 7  do drive(velocity = 200 mm/s, turn = 0 deg/s) }
network { drive = cruise }
"""

SHIFT = """
at 0 s  estop = true, goal_number = 3
at 1 s  estop = false
at 2 s  goal_number = 7
"""
SHIFTED = [(True, 3.0), (False, 3.0), (False, 7.0)]
"""The readings of `estop` and `goal_number` that the scenario gives, in order."""


@pytest.fixture
def pressed(tmp_path: Path) -> Path:
    path = tmp_path / "pressed.colony"
    path.write_text(PRESSED)
    (tmp_path / "shift.scenario").write_text(SHIFT)
    return path


def arguments(behavior: Path) -> tuple[str, ...]:
    scenario = ("--scenario", str(behavior.with_name("shift.scenario")), "--set", "load=12 kg")
    return (
        str(behavior),
        "--duration",
        f"{DURATION_S:g}",
        "--record",
        "r.jsonl",
        *scenario,
    )


def check(run: Started) -> None:
    """Check what a run has read: each value from its time on, and never earlier."""
    assert run.process.returncode == 0, run.err
    rows = [json.loads(line) for line in (run.folder / "r.jsonl").read_text().splitlines()]
    frames = [row for row in rows if row.get("estop") is not None and "goal_number" in row]
    times_s = [row["t"] for row in rows if "t" in row]
    begin_s = min(times_s[0], times_s[-1] + FRAME_S - DURATION_S)  # a busy recorder misses the first frames
    stages = [(frame["estop"], frame["goal_number"]) for frame in frames]
    first_s = {stage: frame["t"] for stage, frame in reversed(list(zip(stages, frames, strict=True)))}
    assert [stage for stage, _ in groupby(stages)] == [s for s in SHIFTED if s in stages]
    assert stages[0] == SHIFTED[0]
    assert first_s[SHIFTED[2]] - begin_s > 2.0 - FRAME_S
    if SHIFTED[1] in first_s:
        assert first_s[SHIFTED[1]] - begin_s > 1.0 - FRAME_S
    else:  # the machine was busy with others for that second: nothing was read in it
        assert any(after["t"] - before["t"] > 1.0 - 2 * FRAME_S for before, after in pairwise(frames))
    assert {frame.get("load") for frame in frames} <= {12.0, None}
    assert any(frame["drive"]["by"] == "cruise" for frame in frames)
    assert all(frame["goal_number"] == 7.0 for frame in frames if frame["drive"]["by"] == "cruise")


@pytest.mark.long
def test_a_run_by_processes_in_a_grid_plays_a_scenario_from_the_start_that_is_chosen(
    machine: Machine, pressed: Path
) -> None:
    where = ("--robot", AMR, "--map", "office", "--start", "5m, 0, 90")
    run = machine.start("run", *arguments(pressed), *where, "--processes", "--no-picture")
    until(lambda: run.ended() or machine.truth(), "the robot is simulated")
    truth = machine.truth()
    assert truth is not None, run.err
    assert (truth.x, truth.y) == (pytest.approx(5000.0, abs=900.0), pytest.approx(0.0, abs=900.0))
    processes = children_of(run.pid)
    run.wait()
    check(run)
    assert not any(map(lives, processes))
    assert machine.directory.running() == {}


def test_a_run_waits_for_a_simulator_that_is_being_started(machine: Machine, pressed: Path) -> None:
    machine.directory.prepare()
    with machine.directory.claim(SUPERVISOR):
        run = machine.start("drive", str(pressed), "--robot", AMR, "--set", "estop=true")
        until(lambda: failed(run) or f"waiting for the Simulator of {ROBOT}" in run.err, "it waits")
        assert run.interrupt() == 130


@pytest.mark.long
def test_a_served_robot_is_given_a_scenario_and_buttons_by_hand(
    machine: Machine, colony: Colony, pressed: Path
) -> None:
    served = machine.start("serve", "all", "--robot", AMR, "--map", MAP)
    until(lambda: failed(served) or SUPERVISOR in machine.directory.running(), "they are being started")
    check(machine.run("drive", *arguments(pressed), "--robot", AMR))
    run = machine.start("drive", str(pressed), "--robot", AMR, "--set", "goal_number=7")
    until(lambda: failed(run) or machine.moves(), "the robot drives")
    held = machine.start("sim", "hold", "Panel.estop=true", "--robot", ROBOT)
    until(lambda: held.ended() or "Ctrl-C ends it" in held.err, "the button is held")
    until(machine.stands, "the button is pressed, and the robot stands")
    assert not held.ended(), held.err
    assert held.interrupt() == 0
    assert machine.stands()  # until somebody starts it
    presses = cycle(["true", "false"])  # only a press after the release counts

    def is_started() -> bool:
        assert colony("data", "set", "Resume", next(presses), "--robot", ROBOT).code == 0
        return machine.moves()

    until(is_started, "the robot drives again")
    held = colony("sim", "hold", "Panel.estop=missing", "Lift.load=2 kg", "--for", "0.2")
    assert held.code == 0
    assert held.err == f"{ROBOT}: Panel.estop=missing, Lift.load=2 kg; ends after 200 ms\n"
    for text, problem in NOT_HELD:
        refused = colony("sim", "hold", text, "--robot", ROBOT)
        assert refused.code == 2, text
        assert problem in refused.err
    assert colony("sim", "hold", "Panel.estop=true", "--for", "0").code == 2
    assert run.interrupt() == 130
    assert served.interrupt() == 0


NOT_HELD = [
    ("estop=true", "found `estop=true`; expected SERVER.FIELD=VALUE"),
    ("Panel.stop=true", "no sensor reads `Panel.stop`; did you mean `Panel.estop`?"),
    ("Panel.estop=7", "Panel.estop: found `7`; expected true or false"),
    ("DServer.X=7", "a variable of DServer is set by `colony data set`"),
    ("RServer.bumper=true", "cannot be given: the simulated base measures it"),
    ("Pump.on=true", "Pump"),
]


def test_what_no_simulator_reads_is_refused(machine: Machine, colony: Colony, pressed: Path) -> None:
    assert "no Simulator runs on this machine" in colony("sim", "hold", "Panel.estop=true").err
    err = colony.refusal("sim", "hold", "Panel.estop=true", "--robot", ROBOT)
    assert f"no Simulator of `{ROBOT}` runs on this machine" in err
    machine.serve("Clock", "--robot", AMR)
    run = colony("drive", pressed, "--robot", AMR, "--set", "estop=true")
    assert run.code == 2
    assert (
        run.err == f"colony: error: `estop` cannot be given: no Simulator of `{ROBOT}` runs on this machine\n"
    )
