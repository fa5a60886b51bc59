"""`colony experiment` from end to end."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.cli.machine import Machine, failed
from tests.waiting import until

QUICK = ("--map", "loop", "--duration", "1", "--vary", "start", "--engine", "serial")

FORWARD = """
language 1
import robot
param pace = 300 mm/s
module forward { when true do drive(velocity = pace, turn = 0 deg/s) }
network { drive = forward }
contract slow: drive.velocity <= 500 mm/s
"""


@pytest.fixture
def forward(tmp_path: Path) -> Path:
    """A behavior that drives straight into walls."""
    path = tmp_path / "forward.colony"
    path.write_text(FORWARD)
    return path


def test_experiment_report_is_the_same_for_any_engine(colony: Colony, tmp_path: Path) -> None:
    out = colony.output("experiment", "wander", *QUICK, "--runs", "2", "--format", "json")
    found = json.loads(out)
    assert found["experiment"] == "on rome in loop"
    assert [run["key"]["seed"] for run in found["runs"]] == [1, 2]
    assert found["behaviors"][0]["contacts"]["cases"] == 0
    pooled = colony("experiment", "wander", *QUICK[:-1], "pool", "--runs", "2", "--format", "json")
    assert pooled.out == out


def test_experiment_with_stored_results_runs_only_what_is_missing(colony: Colony, tmp_path: Path) -> None:
    kept = tmp_path / "r.sqlite"
    first = colony("experiment", "wander", *QUICK, "--runs", "2", "-o", str(kept))
    assert "100 %: 2 of 2 runs, 0 bad" in first.err
    more = colony("experiment", "wander", *QUICK, "--runs", "3", "-o", str(kept))
    assert more.err.splitlines() == ["100 %: 3 of 3 runs, 0 bad"]
    err = colony.refusal("experiment", "wander", *QUICK, "--movers", "1", "--runs", "2", "-o", str(kept))
    assert "with other options" in err


def test_experiment_that_breaks_a_contract_says_where_and_replays_it(
    colony: Colony, forward: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ranges = ("--param", "pace=300..600mm/s")
    result = colony("experiment", str(forward), "--robot", "rome", *QUICK, "--runs", "4", *ranges)
    assert result.code == 1
    assert "contract slow" in result.out
    assert "by pace:" in result.out
    [worst] = [line.rpartition("--replay ")[2] for line in result.out.splitlines() if "look at" in line]
    number = worst.split(",")[0]
    replayed = colony(
        "experiment", str(forward), "--robot", "rome", *QUICK, *ranges, "--replay", number, "--runs", "4"
    )
    assert replayed.code == 0, replayed.err
    assert f"wrote run-{number}.mcap" in replayed.out
    assert f"contract slow: BROKEN first at 0 s: colony explain run-{number}.mcap --at 0" in replayed.out
    audit = colony("audit", f"run-{number}.mcap")
    assert audit.code == 0, audit.out + audit.err
    assert "slow" in audit.out


def test_experiment_against_another_behavior_pairs_runs_and_draws(
    colony: Colony, forward: Path, tmp_path: Path
) -> None:
    picture = tmp_path / "runs.svg"
    result = colony(
        *("experiment", "wander", "--robot", "rome", *QUICK, "--runs", "2", "--versus", str(forward)),
        *("--picture", str(picture), "--audit", "1"),
    )
    assert result.code == 0, result.err
    assert "forward minus wander, 2 pairs of runs with the same inputs:" in result.out
    assert "audited" in result.out
    assert picture.read_text().startswith("<?xml")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "no world: give --map MAP"),
        (("--map", "loop", "--vary", "start", "--start", "0,0,0"), "exclude each other"),
        (("--map", "loop", "--hazards"), "--hazards requires --from and --to"),
        (("--map", "loop", "--from", "201"), "found --from alone"),
        (("--map", "loop", "--movers", "5..1"), "--movers: found `5..1`"),
        (("--map", "loop", "--movers", "-1"), "--movers: found `-1`"),
        (("--map", "loop", "--param", "avoid.clearance=1m"), "--param avoid.clearance: found `1m`"),
        (("--map", "loop", "--param", "avoid.clearance"), "expected each param once"),
        (("--map", "loop", "--engine", "abacus"), "--engine: found `abacus`"),
        (("--map", "loop", "--picture", "runs.doc"), "--picture"),
        (("--map", "loop", "--audit", "nan"), "expected a fraction"),
        (("--map", "loop", "--versus", "wander"), "the same file twice"),
        (("--map", "loop", "--duration", "soon"), "soon"),
    ],
)
def test_experiment_with_impossible_options_is_refused(
    colony: Colony, options: tuple[str, ...], message: str
) -> None:
    assert message in colony.refusal("experiment", "wander", *options)


def test_experiment_with_a_param_that_does_not_exist_is_refused_before_the_first_run(colony: Colony) -> None:
    err = colony.refusal("experiment", "wander", *QUICK, "--param", "avoid.clearence=0.6..1.4m", code=1)
    assert "avoid.clearance" in err
    assert "100 %" not in err


def test_experiment_interrupted_keeps_finished_runs(machine: Machine, tmp_path: Path) -> None:
    kept = tmp_path / "r.sqlite"
    endless = ("wander", *QUICK, "--runs", "5000", "-o", str(kept))

    def finished() -> int:
        try:
            with sqlite3.connect(f"file:{kept}?mode=ro", uri=True) as file:
                return int(file.execute("SELECT count(*) FROM trial").fetchone()[0])
        except sqlite3.Error:
            return 0

    run = machine.start("experiment", *endless)
    until(lambda: failed(run) or finished() >= 2, "two runs are finished")
    assert run.interrupt() == 130
    assert "wander on rome in loop" in run.out
    assert finished() >= 2
