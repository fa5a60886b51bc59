"""`python -m studies lights` and `plates` from end to end."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import pytest

from colony.experiment.results import RunKey
from studies.conduct import conduct
from studies.outputs import describe_run, is_failed
from studies.sources.results import ALL_SOURCES, PoseErrors, SourceOutcome, SourceResult
from tests.studies.conftest import Studies

QUICK = ("lights", "--runs", "29", "--seeds", "2", "--no-hazards", "--engine", "serial")


@pytest.mark.thorough
def test_lights_are_counted_kept_and_put_into_a_page(studies: Studies, tmp_path: Path) -> None:
    kept, page = tmp_path / "r.sqlite", tmp_path / "page.md"
    name = "lights ours/no-hazards"
    page.write_text(f"Before.\n\n<!-- {name} -->\nOld.\n<!-- end of {name} -->\n\nAfter.\n")
    first = studies(*QUICK, "-o", str(kept), "--write", str(page))
    assert first.code == 0
    assert "lights, ours/no-hazards: 2 of 2 runs" in first.out
    assert "lights that are on and were passed: detected" in first.out
    assert "100 %: 2 of 2 run, 0 bad" in first.err
    text = page.read_text()
    assert text.startswith("Before.\n\n<!-- ")
    assert text.endswith(" -->\n\nAfter.\n")
    assert "| 29  | A392L | A340R | 2/2 " in text
    again = studies(*QUICK, "-o", str(kept), "--format", "json")
    assert again.err == ""
    told = json.loads(again.out)
    assert [one["seed"] for one in told["results"]] == [1, 2]
    assert all(target["met"] for target in told["targets"])
    assert "key" not in told["results"][0]
    assert (told["results"][0]["from"], told["results"][0]["to"]) == ("A392L", "A340R")
    counts = told["results"][0]["counts"]
    assert counts["passed"] == counts["detected"] > 0
    with sqlite3.connect(kept) as database:
        [(passed,)] = database.execute("SELECT sum(passed) FROM lights").fetchall()
    database.close()
    assert passed == sum(one["counts"]["passed"] for one in told["results"])


@pytest.mark.parametrize(
    ("more", "problem"),
    [
        (("--map", "loop"), "leave out --map"),
        (("--plot", "pictures"), "leave out --plot, --audit and --variant"),
        (("--audit", "1"), "leave out --plot, --audit and --variant"),
        (("--variant", "thesis"), "leave out --plot, --audit and --variant"),
        (("--runs", "12"), "no run 12; expected numbers from 1 to 11"),
    ],
)
def test_what_makes_no_sense_is_refused(
    studies: Studies, more: tuple[str, ...], problem: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert problem in studies.refusal("plates", *more)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
def test_ctrl_c_loses_no_run_that_was_finished(
    studies: Studies, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tmp_path / "r.sqlite"

    def interrupted(asked: object, *rest: object, on_progress: object) -> None:
        def stop(done: int, of: int, newest: object) -> None:
            raise KeyboardInterrupt

        conduct(asked, *rest, on_progress=stop)  # type: ignore[arg-type]

    monkeypatch.setattr("studies.conduct.conduct", interrupted)
    result = studies(*QUICK, "-o", str(kept))
    assert result.code == 130
    assert "lights, ours/no-hazards: 1 of 2 runs" in result.out
    monkeypatch.undo()
    assert "2 of 2 runs" in studies.output(*QUICK, "-o", str(kept))


def test_the_newest_run_of_each_study_is_told() -> None:
    outcome = SourceOutcome(failure="stuck", goal_error_mm=0.0, contact_mm_s=0.0, errors=PoseErrors())
    key = RunKey("sources", 22, 3, "ours")
    newest = SourceResult(key=key, origin="A", goal="B", outcomes={ALL_SOURCES: outcome})
    assert describe_run(newest) == "run 22, seed 3, stuck"
    assert is_failed(newest)
