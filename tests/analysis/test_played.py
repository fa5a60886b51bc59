"""The run of a proof as a recording: its outcomes, and fates and sources that a server would have given."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from colony.analysis.audit import audit
from colony.analysis.played import PlayedRun
from colony.dsl.load import load_text
from colony.ir.frame import OverriddenCommand
from colony.ir.program import Program
from colony.verify.contracts.disturbances import with_operator_runs
from colony.verify.contracts.prove import results
from colony.verify.contracts.results import ProofOptions, Proved, trace_of
from colony.verify.snapshot import Snapshot
from tests.watch.runs import PROGRAM

ROBOT = """
robot r {
  frame 100 ms
  sensor sonar : m from PServer.sonar
  sensor tilt  : rad from RServer.tilt
  sensor bump  : bool default false from RServer.bumper
  actuator drive { velocity : m/s range -1 .. 1 } to RServer.drive idle drive(velocity = 0)
  actuator arm { level : number range 0 .. 1 } to AServer.arm idle arm(level = 0) on_loss degrade
}
module back { when bump do drive(velocity = -0.1 m/s) }
module go { when true do drive(velocity = 0.3 m/s) }
module wave { when not bump do arm(level = 1) }
module rest { when true do arm(level = 0.5) }
network { drive = back suppresses go  arm = wave suppresses rest }
"""

CONTRACTS = {
    "a reading of another unit": "contract c: sonar < 1.1 m implies drive.velocity <= 0.2 m/s",
    "the edge of a comparison": "contract c: tilt == 0.1 rad implies drive.velocity < 0 m/s",
    "memory": "contract c: not (drive by go and recently(bump, 1 s))",
    "a late client": "contract c: arm.level > 0 or drive.velocity < 0.3 m/s",
    "a sent value": "contract c: not (last.drive.velocity < 0 m/s and drive by go)",
}


def first(program: Program) -> object:
    [result] = results(program, ["c"], ProofOptions())
    return result


@pytest.mark.parametrize("case", CONTRACTS)
def test_a_run_that_breaks_a_contract_breaks_it_in_its_last_frame(case: str) -> None:
    program = load_text(ROBOT + CONTRACTS[case])
    trace = trace_of(first(program))  # type: ignore[arg-type]
    assert trace is not None
    run = PlayedRun(program, trace.snapshots)
    assert [f.breaches for f in run.recorded] == [o.breaches for o in trace.outcomes]
    assert [f.expected.decisions for f in run.recorded] == [o.decisions for o in trace.outcomes]
    report = audit(program, run.frames(program))
    assert (report.differing, report.unknown, report.contracts[0].contract) == (0, 0, "c")


def test_a_late_client_has_its_fate() -> None:
    program = load_text(ROBOT + CONTRACTS["a late client"])
    trace = trace_of(first(program))  # type: ignore[arg-type]
    assert trace is not None
    last = PlayedRun(program, trace.snapshots).recorded[-1].verdicts["arm"]
    assert (last.by, last.values, last.outside) == (None, (0.0,), None)
    assert {"late", "lost"} & {fate for _, fate in last.fates}


def test_a_command_from_outside_has_its_source() -> None:
    program = load_text(ROBOT + "contract c: bump implies drive.velocity <= 0 m/s")
    proved = first(program)
    assert isinstance(proved, Proved)
    assert not proved.operators
    [trace] = with_operator_runs(program, proved).operator_runs or ()
    last = PlayedRun(program, trace.snapshots).recorded[-1]
    verdict = last.verdicts["drive"]
    assert verdict.outside == "operator/1"
    assert dict(verdict.fates)["back"] == "overridden"
    assert last.breaches == ("c",)


def test_a_module_in_python_answers_as_the_proof_assumed() -> None:
    python = 'module p from python "nowhere:Nothing" { reads sonar commands drive }'
    text = ROBOT.replace("network { drive = back", f"{python} network {{ drive = p suppresses (back")
    program = load_text(
        text.replace("suppresses go ", "suppresses go) ") + "contract c: drive.velocity < 0.9 m/s"
    )
    trace = trace_of(first(program))  # type: ignore[arg-type]
    assert trace is not None
    last = PlayedRun(program, trace.snapshots).recorded[-1]
    assert last.breaches == ("c",)
    assert last.verdicts["drive"].by == "p"
    assert dict(last.verdicts["drive"].fates)["p"] == "won"


def test_lost_clients_and_restarts_are_in_the_ticks() -> None:
    program = load_text(ROBOT)
    calm = Snapshot(0, {"bump": False})
    frames = (
        calm,
        replace_snapshot(calm, 1, lost=frozenset({"wave"})),
        replace_snapshot(calm, 2, restarted=True),
        replace_snapshot(calm, 3, given={"drive": OverriddenCommand(None)}),
    )
    run = PlayedRun(program, frames).recorded
    assert [f.tick.lost for f in run] == [(), ("AServer/wave",), (), ()]
    assert [f.verdicts["arm"].by for f in run] == ["wave", "rest", "wave", "wave"]
    assert dict(run[1].verdicts["arm"].fates) == {"wave": "lost", "rest": "won"}
    assert [(f.restart, f.tick.start) for f in run] == [(False, 0), (False, 0), (True, 2), (False, 2)]
    assert dict(run[3].verdicts["drive"].fates) == {"back": "inactive", "go": "late"}
    assert audit(program, run).differing == 0


def replace_snapshot(snapshot: Snapshot, k: int, **changes: object) -> Snapshot:
    return snapshot._replace(t_ns=k * 100_000_000, **changes)  # type: ignore[arg-type]


def test_a_reading_without_a_number_of_its_unit_is_the_nearest() -> None:
    [sonar] = [s for s in PROGRAM.robot.sensors if s.name == "ranges"]
    assert sonar.factor == 1000
    exact, near = 1100.0, math.nextafter(1000.0, 2000)  # no number times 1000 is the float after 1000
    program = replace(PROGRAM, contracts=())
    [frame] = PlayedRun(program, [Snapshot(0, {"ranges": (exact, near, 1.0, 0.1)})]).recorded
    found = [x * 1000 for x in frame.frame.readings["ranges"]]  # type: ignore[union-attr,operator]
    assert (found[0], found[2], found[3]) == (exact, 1.0, 0.1)
    assert found[1] == pytest.approx(near, rel=1e-15)
