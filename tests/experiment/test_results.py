"""The file of results: what is there stays, whatever ends the process."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest

from colony.experiment.results import KEY_COLUMNS, Points, Results, ResultsError, ResultTable, RunKey
from tests.paths import ROOT


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """A result with a column of each sort."""

    key: RunKey
    failure: Literal["", "stuck"] = ""
    error_mm: float = 0.25
    found: bool = True
    size: tuple[int, float] = (3, 0.5)
    names: tuple[str, ...] = ("é", "")
    path: Points = ((1, -2), (30_000, 4))


TABLE = ResultTable(
    name="measured",
    kind=Measured,
    columns=(*KEY_COLUMNS, "failure", "error_mm", "found", "width", "height", "names", "path"),
)


def measured(number: int, seed: int, **values: Any) -> Measured:
    return Measured(key=RunKey("rounds", number, seed, "plain"), **values)


def test_results_come_back_as_they_were(tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    kept = [
        measured(1, 1),
        measured(2, 1, failure="stuck", found=False),
        measured(1, 2),
        measured(2, 2, path=()),
    ]
    with Results(path, TABLE) as results:
        for one in kept:
            results.put(one)
    with Results(path, TABLE) as results:
        assert results.select("rounds", "plain") == tuple(sorted(kept, key=lambda one: one.key))
        assert results.keys() == {one.key for one in kept}
        assert results.select("rounds", "other") == results.select("others", "plain") == ()


def test_the_same_run_again_takes_the_place_of_the_old_one() -> None:
    with Results(None, TABLE) as results:
        results.put(measured(1, 1))
        results.put(measured(1, 1, error_mm=7.0))
        assert [one.error_mm for one in results.select("rounds", "plain")] == [7.0]


def test_results_of_another_program_are_not_mixed_in(tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    with Results(path, TABLE) as results:
        results.expect("rounds", "plain", "one")
        results.expect("rounds", "other", "other")
        results.expect("rounds", "plain", "one")
    with (
        Results(path, TABLE) as results,
        pytest.raises(
            ResultsError, match="another program, map, version of colony, or with other options; choose"
        ),
    ):
        results.expect("rounds", "plain", "changed")


def test_a_file_of_something_else_is_refused_and_left_alone(tmp_path: Path) -> None:
    text, other = tmp_path / "text.sqlite", tmp_path / "other.sqlite"
    text.write_text("no database, but long enough to be taken for one " * 40)
    with sqlite3.connect(other) as database:
        database.execute("CREATE TABLE precious (x)")
    database.close()
    for path in (text, other, tmp_path / "nowhere" / "r.sqlite"):
        with pytest.raises(ResultsError, match="choose another file"):
            Results(path, TABLE)
    with sqlite3.connect(other) as database:
        assert database.execute("SELECT name FROM sqlite_master").fetchall() == [("precious",)]
    database.close()


@pytest.mark.parametrize(
    "change",
    [
        "DROP TABLE made",
        "ALTER TABLE measured DROP COLUMN found",
        "UPDATE measured SET names = '{'",
        "UPDATE measured SET names = '[1]'",
        "UPDATE measured SET path = x'010203'",
        "UPDATE measured SET width = 'wide'",
        "UPDATE measured SET error_mm = 'far'",
        "PRAGMA user_version = 3",
    ],
)
def test_results_of_a_changed_file_are_refused(change: str, tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    with Results(path, TABLE) as results:
        results.put(measured(1, 1))
    with sqlite3.connect(path) as database:
        database.execute(change)
    database.close()
    with pytest.raises(ResultsError, match="choose another file"), Results(path, TABLE) as results:
        results.select("rounds", "plain")


def _read(results: Results[Measured]) -> None:
    results.expect("rounds", "plain", "one")
    results.keys()


def test_results_of_a_damaged_file_are_refused(tmp_path: Path) -> None:
    path, damaged = tmp_path / "r.sqlite", tmp_path / "damaged.sqlite"
    with Results(path, TABLE) as results:
        results.put(measured(1, 1))
    whole = path.read_bytes()
    for page in range(4096, len(whole), 4096):
        damaged.write_bytes(whole[:page] + bytes(4096) + whole[page + 4096 :])
        with pytest.raises(ResultsError, match="malformed"), Results(damaged, TABLE) as results:
            _read(results)


def test_results_wait_for_another_process_that_begins_the_file(tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    first = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    first.execute("BEGIN IMMEDIATE")
    committing = threading.Timer(0.005, lambda: first.execute("COMMIT"))
    committing.start()
    with Results(path, TABLE) as results:
        assert results.keys() == frozenset()
    committing.join()
    first.close()


def test_results_are_in_a_file_of_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with Results(Path(":memory:"), TABLE) as results:
        results.put(measured(1, 1))
    assert [path.name for path in tmp_path.iterdir()] == [":memory:"]


@pytest.mark.skipif(os.name != "posix", reason="there is no SIGKILL")
def test_what_was_put_survives_sigkill(tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    program = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from colony.experiment.results import Results\n"
        "from tests.experiment.test_results import TABLE, measured\n"
        "results = Results(Path(sys.argv[1]), TABLE)\n"
        "for seed in range(1, 100_000):\n"
        "    results.put(measured(1, seed))\n"
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
    with Results(path, TABLE) as results:
        kept = [one.key.seed for one in results.select("rounds", "plain")]
    assert kept == list(range(1, len(kept) + 1))
    assert len(kept) >= told[-1]
