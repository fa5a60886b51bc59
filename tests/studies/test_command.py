"""`python -m studies` from end to end."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from colony.experiment.results import RunKey
from studies import outputs as experiment_outputs
from studies.auditing import AuditedRun
from studies.outputs import ExperimentOutcome
from tests.nav.floors import two_floors
from tests.paths import ROOT
from tests.studies.conftest import Studies
from tests.waiting import PATIENCE_S, killed_in_the_end, until

MAP = str(ROOT / "maps" / "msu_engineering_3.stickrep")
QUICK = ("thesis", "--runs", "29", "--seeds", "1", "--no-hazards", "--engine", "serial")


@pytest.fixture
def rounds(tmp_path: Path) -> Path:
    """A list of one's own: two short ways."""
    path = tmp_path / "rounds.csv"
    path.write_text("from,to\nA342L,A340R\nA339L,A338R\n")
    return path


@pytest.mark.thorough
def test_published_runs_beside_ours(studies: Studies) -> None:
    result = studies(*QUICK)
    assert result.code == 0
    assert "thesis, ours/no-hazards: 1 of 1 runs" in result.out
    [row] = [line for line in result.out.splitlines() if line.startswith("| 29 ")]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[:5] == ["29", "A392L", "A340R", "15.1", "1/1"]
    assert cells[12:] == ["+0.07 m", "3:09", "4.8", "1/1", "1/1", "1/1"]
    assert "runs that reached the goal" in result.out
    assert "a corner is passed" in result.out
    assert "100 %: 1 of 1 run, 0 bad" in result.err


@pytest.mark.thorough
def test_results_are_kept_and_not_made_again(studies: Studies, rounds: Path, tmp_path: Path) -> None:
    kept = tmp_path / "r.sqlite"
    arguments = (str(rounds), "--map", MAP, "--engine", "serial", "--no-hazards", "-o", str(kept))
    told = json.loads(studies.output(*arguments, "--format", "json"))
    assert [one["number"] for one in told["results"]] == [1, 2]
    assert all(one["reached"] for one in told["results"])
    assert told["variant"] == "ours/no-hazards"
    again = studies(*arguments, "--format", "json")
    assert json.loads(again.out) == told
    assert again.err == ""
    with sqlite3.connect(kept) as database:
        [(count,)] = database.execute("SELECT count(*) FROM run WHERE failure = ''").fetchall()
    database.close()
    assert count == 2


@pytest.mark.thorough
def test_pictures_and_a_page(studies: Studies, rounds: Path, tmp_path: Path) -> None:
    page, pictures = tmp_path / "page.md", tmp_path / "pictures"
    arguments = (str(rounds), "--map", MAP, "--engine", "serial", "--no-hazards", "--write", str(page))
    page.write_text("Before.\n\n<!-- x -->\nOld.\n<!-- end of x -->\n\nAfter.\n")
    err = studies.refusal(*arguments)
    assert "100 %" not in err
    name = err.split("<!-- ")[1].split(" -->")[0]
    page.write_text(f"Before.\n\n<!-- {name} -->\nOld.\n<!-- end of {name} -->\n\nAfter.\n")
    result = studies(*arguments, "--plot", str(pictures), "--format", "json")
    assert result.code == 0
    assert len(json.loads(result.out)["results"]) == 2
    assert f"inserted the tables into {page}" in result.err
    assert f"drawn in {pictures}: 2 pictures of paths" in result.err
    text = page.read_text()
    assert text.startswith("Before.\n\n<!-- ")
    assert text.endswith(" -->\n\nAfter.\n")
    assert "| A342L | A340R |" in text
    assert "Old." not in text
    assert sorted(path.name for path in pictures.iterdir()) == [
        "A339L_to_A338R.png",
        "A342L_to_A340R.png",
        "errors.png",
    ]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in pictures.iterdir())


@pytest.mark.thorough
def test_ways_are_drawn_on_their_floor_and_none_on_two(studies: Studies, tmp_path: Path) -> None:
    two_floors(tmp_path)
    ways, pictures = tmp_path / "ways.csv", tmp_path / "pictures"
    ways.write_text("from,to\nA,C\nupper:A,upper:C\nliftR,upper:D\n")
    arguments = (str(ways), "--map", str(tmp_path / "ground.stickrep"), "--engine", "serial", "--no-hazards")
    err = studies.refusal(*arguments, "--plot", str(pictures))
    assert "run 3 has one: `colony run ... --from liftR --to upper:D` draws each" in err
    studies.output(*arguments, "--plot", str(pictures), "--runs", "1,2")
    names = sorted(path.name for path in pictures.iterdir())
    assert names == ["A_to_C.png", "A_to_C_of_upper.png", "errors.png"]


def test_pages_that_cannot_be_filled_are_told_before_the_runs(studies: Studies, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_bytes(b"\xff<!-- thesis ours/no-hazards -->")
    told = f"{page}: error: cannot write: byte 0 is not UTF-8; expected a Markdown page\n"
    assert studies(*QUICK, "--write", str(page)) == (2, "", told)
    source = tmp_path / "page.colony"
    source.write_text("<!-- thesis ours/no-hazards -->\n<!-- end of thesis ours/no-hazards -->\n")
    result = studies(*QUICK, "--write", str(source))
    assert (result.code, result.err) == (
        2,
        f"{source}: error: cannot write: it is a source file that already exists\n",
    )


@pytest.mark.thorough
def test_random_pairs(studies: Studies) -> None:
    arguments = ("random", "--map", str(ROOT / "maps" / "loop.stickrep"), "--pairs", "2", "--seed", "3")
    told = json.loads(studies.output(*arguments, "--engine", "serial", "--format", "json"))
    assert told["list"] == "random 2 pairs, seed 3, loop"
    assert len(told["results"]) == 2


@pytest.mark.thorough
def test_an_audit_says_what_it_compared(studies: Studies, rounds: Path) -> None:
    arguments = (str(rounds), "--map", MAP, "--engine", "serial", "--no-hazards", "--runs", "1")
    out = studies.output(*arguments, "--audit", "0.0001")
    assert "Audited: 1 runs, " in out
    assert "decided the same in all of them" in out


def test_differences_are_told() -> None:
    key = RunKey("x", 1, 1, "ours")
    found = ExperimentOutcome(
        results=(),
        audits=(
            AuditedRun(key=key, frames=3, difference=""),
            AuditedRun(key=key, frames=4, difference="frame 4"),
        ),
        interrupted=False,
    )
    assert [one.frames for one in found.differences] == [4]
    assert experiment_outputs._audit_line(found.audits).endswith("decided differently in 1 of them.")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("rounds.csv",), "give --map MAP"),
        (("rounds",), "unknown list `rounds`; expected thesis, plates, lights, sources, random"),
        (
            ("rounds", "--map", MAP),
            "unknown list `rounds`; expected thesis, plates, lights, sources, random",
        ),
        (("none.csv", "--map", MAP), "none.csv: cannot be read"),
        (("thesis", "--map", MAP), "leave out --map"),
        (("thesis", "--runs", "41"), "no run 41"),
        (("thesis", "--audit", "nan"), "`nan`; expected a fraction of the runs, from 0 to 1"),
        (("thesis", "--audit", "1.5"), "`1.5`; expected a fraction of the runs, from 0 to 1"),
        (("plates", "--pairs", "3"), "--pairs requires the list `random` or `floors`; found `plates`"),
        (("thesis", "--no-hazard", "rain"), "unknown hazard `rain`; expected slip, glass"),
        (("thesis", "--engine", "cloud"), "unknown engine `cloud`; expected pool, serial, dask"),
        (("thesis", "-o", "/nowhere/r.sqlite"), "the folder does not exist"),
    ],
)
def test_misuse_is_one_line_and_2(studies: Studies, arguments: tuple[str, ...], told: str) -> None:
    err = studies.refusal(*arguments)
    assert told in err
    assert "Traceback" not in err


@pytest.mark.thorough
@pytest.mark.skipif(os.name != "posix", reason="there is no SIGINT to send")
def test_ctrl_c_keeps_what_is_finished(tmp_path: Path) -> None:
    kept = tmp_path / "r.sqlite"
    command = [
        sys.executable,
        "-m",
        "studies",
        "thesis",
        "--runs",
        "29,33",
        "--seeds",
        "9",
    ]
    started = subprocess.Popen(
        [*command, "--no-hazards", "--engine", "serial", "-o", str(kept)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    with killed_in_the_end(started) as child:
        until(lambda: child.poll() is not None or _count(kept), "a run is kept")
        assert child.poll() is None
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 130
    assert f"{_count(kept)} of 18 runs" in out
    assert "Traceback" not in err


def _count(path: Path) -> int:
    if not path.exists():
        return 0
    with sqlite3.connect(path) as database:
        try:
            [(count,)] = database.execute("SELECT count(*) FROM run").fetchall()
        except sqlite3.OperationalError:
            count = 0
    database.close()
    return int(count)
