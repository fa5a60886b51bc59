"""Drawn traces as `colony verify` tells of them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from sarif_kit.validate import validation_errors

from colony.cli.sarif import sarif
from colony.cli.verify.examples import bug, findings, lines, reports, row
from colony.dsl.load import load_file, load_text
from colony.ir.program import Program
from colony.verify.contracts.results import refutation
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.differential import DifferentialReport
from tests.cli.conftest import Colony
from tests.paths import ROOT

TEXT = """
robot r {
  sensor near : mm range 0 .. 5000 from S.near
  sensor bumper : bool from S.bumper
  actuator drive { velocity : mm/s range -600 .. 600 } to A.drive idle drive(velocity = 0)
}
module cruise { when near >= 400 mm do drive(velocity = near / 1 s) }
module back   { when recently(bumper, 100 ms) do drive(velocity = -100 mm/s) }
module never  { when near > 6 m do drive(velocity = 0) }
module stop   { when near > 6 m }
network { drive = stop inhibits (never suppresses (back suppresses cruise)) }
contract bounded: drive.velocity in -600 mm/s .. 600 mm/s
contract no_forward_after_bump: recently(bumper, 200 ms) implies drive.velocity <= 0
"""

UNSTEADY = """
robot r {
  sensor heading : deg from DServer.heading
  actuator out { v : number } to DServer.out idle hold
}
module plan from python "tests.verify.testing.unsteady_modules:Shared" { reads heading commands out }
network { out = plan }
"""


def last(of: Program, count: int, seed: int = 1, *, faults: bool = False) -> DifferentialReport:
    *_, report = reports(of, count, seed, faults=faults)
    return report


@pytest.fixture(scope="module")
def of() -> Program:
    return load_text(TEXT, "b.colony")


@pytest.fixture(scope="module")
def report(of: Program) -> DifferentialReport:
    return last(of, 60)


def test_modules_that_never_won_are_named(of: Program, report: DifferentialReport) -> None:
    *_, never = lines(of, report)
    assert never == "never won in any trace: never"


def test_a_broken_contract_is_shown_with_its_shortest_trace(of: Program, report: DifferentialReport) -> None:
    told = lines(of, report)
    (at,) = [i for i, line in enumerate(told) if line.startswith("REFUTED")]
    assert "no_forward_after_bump" in told[at]
    heading, bumped, after = told[at + 1 : at + 4]
    assert heading.split() == ["time", "near", "bumper", "drive"]
    assert "true" in bumped
    assert "by cruise" in after
    assert "0 s" not in [
        line.strip()[:3] for line in lines(of, report, refuted_names=["no_forward_after_bump"])
    ]


def test_findings_are_errors_at_the_contract_with_a_trace(of: Program, report: DifferentialReport) -> None:
    (found,) = findings(of, report, "b.colony")
    assert (found.code, found.span.text) == ("V010", "no_forward_after_bump")
    assert "drive by cruise" in found.message
    ((_, steps),) = findings(of, report, "b.colony").items()
    assert steps[0].message == "t = 0 s; drive by back: velocity = -100 mm/s"
    assert steps[0].values["bumper"] == "true"
    assert len(steps) == 2
    assert findings(of, report, "b.colony", refuted_names=["no_forward_after_bump"]) == {}
    log = sarif([found], directory="/", command="verify", traces=findings(of, report, "b.colony"))
    assert validation_errors(json.loads(log)) == []


def test_a_breach_is_one_for_the_prover_too(of: Program, report: DifferentialReport) -> None:
    (breach,) = report.breaches
    result = refutation(of, breach)
    interpreter = Interpreter(of)
    for snapshot, outcome in zip(result.trace.snapshots, result.trace.outcomes, strict=True):
        assert repr(interpreter.step_in_base_units(snapshot.t_ns, snapshot.readings)) == repr(outcome)
    assert result.trace.outcomes[-1].breaches == ("no_forward_after_bump",)


def test_an_object_for_other_programs(of: Program, report: DifferentialReport) -> None:
    found = json.loads(json.dumps(row(of, report)))
    assert found["drawn"] == found["asked"] == 60
    assert found["frames"] == report.frames
    assert [m["module"] for m in found["modules"]] == ["cruise", "back", "never", "stop"]
    (broken,) = found["broken"]
    assert broken["contract"] == "no_forward_after_bump"
    assert len(broken["trace"]) == 2
    assert found["disagreement"] is None


def test_a_mistake_in_the_compiler_is_told_as_a_bug_of_colony(
    of: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    from colony.execute import executor

    def last_one(self: object, actuator: object) -> object:
        clients: Sequence[object] = actuator.clients  # type: ignore[attr-defined]
        values = self._machine.values  # type: ignore[attr-defined]
        return next((c for c in reversed(clients) if values[c.guard]), None)  # type: ignore[attr-defined]

    monkeypatch.setattr(executor.ProgramExecutor, "_winner", last_one)
    report = last(of, 60)
    assert report.drawn < 60
    told = lines(of, report)
    assert told[0].endswith("executors DISAGREE")
    assert "clients by priority: differs from the reference" in told[2]
    said = bug(report)
    assert said is not None
    assert len(report.disagreement.trace) == 1
    assert json.dumps(row(of, report))


def test_a_module_in_python_that_is_not_deterministic_is_an_error() -> None:
    of = load_text(UNSTEADY)
    report = last(of, 20)
    (found,) = findings(of, report, "b.colony")
    assert (found.code, found.span.text) == ("P002", "plan")
    assert len(lines(of, report)) == 1


def test_the_command_tells_and_leaves_nothing_behind(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "b.colony").write_text(TEXT)
    code, out, err = colony("verify", "--examples", "20", "--seed", "3", "--faults", "b.colony")
    assert code == 1
    assert "20 traces with" in out
    assert "error[V010]" in err
    assert [p.name for p in tmp_path.iterdir()] == ["b.colony"]
    assert colony("verify", "--examples", "20", "--seed", "3", "--faults", "b.colony").out == out


def test_hypothesis_is_not_loaded() -> None:
    """Drawing needs none of it: it would take time, and leave a folder behind."""
    code = "import colony.cli.verify.examples, sys; print('hypothesis' in sys.modules, 'z3' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


@pytest.mark.parametrize("name", ["wander", "figure_4_14", "teleop"])
def test_behaviors(name: str) -> None:
    of = load_file(ROOT / "behaviors" / f"{name}.colony")
    report = last(of, 12, seed=5)
    assert report.disagreement is None, str(report.disagreement)
    assert report.breaches == ()
