"""Files from outside, changed at random: a sample of `python -m tools.file_mutants`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.mutants import Case, cases, read, try_mutant
from tests.sampling import long, thorough

NAMES = [
    *("p.mcap", "p.jsonl"),
    *(f"{stem}.{suffix}" for stem in "bm" for suffix in ("mcap", "jsonl", "input", "colonyc")),
]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Case]:
    return cases(tmp_path_factory.mktemp("cases"))


@pytest.mark.parametrize("seed", [1, long(2), *map(thorough, range(3, 7))])
@pytest.mark.parametrize("name", NAMES)
def test_a_changed_file_is_read_or_refused(
    made: dict[str, Case], name: str, seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("tests.cli.mutants.PATIENCE_S", float("inf"))
    monkeypatch.setattr("sys.argv", ["colony"])
    case, codes = made[name], set()
    for i in range(20):
        code, wrong = try_mutant(name, case, f"{seed}-{i}", tmp_path)
        codes.add(code)
        assert wrong is None, wrong
    assert 2 in codes, "some are refused"
    assert len(codes) > 1 or name.endswith(".colonyc"), "some are read"


@pytest.mark.parametrize("name", ["b.colonyc", "m.colonyc"])
def test_an_unchanged_program_is_read(made: dict[str, Case], name: str, tmp_path: Path) -> None:
    path = tmp_path / "x.colonyc"
    path.write_bytes(made[name].content)
    assert read(made[name].commands[0], path) == (0, "")
