"""The file of results: what is there stays, whatever ends the process."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from colony.experiment.results import RUN_TABLE, Results, ResultsError
from tests.experiment.stage import REACHED, STUCK, result
from tests.paths import ROOT


def test_results_come_back_as_they_were(tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    kept = [result(1, 1), result(2, 1, STUCK), result(1, 2), replace(result(2, 2), path=(), remark="é")]
    with Results(path, RUN_TABLE) as results:
        for one in kept:
            results.put(one)
    with Results(path, RUN_TABLE) as results:
        assert results.select("thesis", "ours") == tuple(sorted(kept, key=lambda one: one.key))
        assert results.keys() == {one.key for one in kept}
        assert results.select("thesis", "thesis") == results.select("own", "ours") == ()


def test_the_same_run_again_takes_the_place_of_the_old_one() -> None:
    with Results(None, RUN_TABLE) as results:
        results.put(REACHED)
        results.put(replace(REACHED, goal_error_mm=7.0))
        assert [one.goal_error_mm for one in results.select("thesis", "ours")] == [7.0]


def test_results_of_another_program_are_not_mixed_in(tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    with Results(path, RUN_TABLE) as results:
        results.expect("thesis", "ours", "one")
        results.expect("thesis", "thesis", "other")
        results.expect("thesis", "ours", "one")
    with (
        Results(path, RUN_TABLE) as results,
        pytest.raises(ResultsError, match="another program or map; choose another"),
    ):
        results.expect("thesis", "ours", "changed")


def test_a_file_of_something_else_is_refused_and_left_alone(tmp_path: Path) -> None:
    text, other = tmp_path / "text.sqlite", tmp_path / "other.sqlite"
    text.write_text("no database, but long enough to be taken for one " * 40)
    with sqlite3.connect(other) as database:
        database.execute("CREATE TABLE precious (x)")
    database.close()
    for path in (text, other, tmp_path / "nowhere" / "r.sqlite"):
        with pytest.raises(ResultsError, match="choose another file"):
            Results(path, RUN_TABLE)
    with sqlite3.connect(other) as database:
        assert database.execute("SELECT name FROM sqlite_master").fetchall() == [("precious",)]
    database.close()


@pytest.mark.skipif(os.name != "posix", reason="there is no SIGKILL")
def test_what_was_put_survives_sigkill(tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    program = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from colony.experiment.results import RUN_TABLE, Results\n"
        "from tests.experiment.stage import result\n"
        "results = Results(Path(sys.argv[1]), RUN_TABLE)\n"
        "for seed in range(1, 100_000):\n"
        "    results.put(result(1, seed))\n"
        "    print(seed, flush=True)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(path)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as child:
        assert child.stdout is not None
        told = [int(child.stdout.readline()) for _ in range(25)]
        child.send_signal(signal.SIGKILL)
    with Results(path, RUN_TABLE) as results:
        kept = [one.key.seed for one in results.select("thesis", "ours")]
    assert kept == list(range(1, len(kept) + 1))
    assert len(kept) >= told[-1]
