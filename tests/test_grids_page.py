"""docs/grids.md: what it shows is read and run, and its numbers are those of the reader."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from colony.nav.maps.grid import keys
from colony.nav.maps.grid.image import FORMATS, MAX_CELLS, MAX_IMAGE_BYTES
from colony.nav.maps.grid.outlines import MAX_SIDES
from colony.nav.maps.grid.reader import MAX_YAML_BYTES
from colony.nav.maps.world_map import MAX_WALLS
from colony.text.source import Source
from tests.cli.conftest import Colony
from tests.cli.conftest import colony as colony
from tests.paths import MAPS, ROOT

PAGE = (ROOT / "docs" / "grids.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("office.yaml", "office.png"):
        shutil.copy(MAPS / name, name)
    return tmp_path


def test_every_block_is_checked() -> None:
    assert set(BLOCKS) == {"sh", "yaml", "python"}


def test_the_keys_are_those_of_the_office() -> None:
    kept = (MAPS / "office.yaml").read_text()
    assert BLOCKS["yaml"] == "".join(line for line in kept.splitlines(True) if not line.startswith("#"))
    keys.read_keys(Source("shown", BLOCKS["yaml"]))
    listed = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)
    assert sorted(listed) == sorted(re.findall(r"^(\w+):", BLOCKS["yaml"], re.MULTILINE))


def test_the_commands_run(folder: Path, colony: Colony) -> None:
    *commands, served = BLOCKS["sh"].splitlines()
    assert served == "colony serve all --robot amr --map office.yaml"
    for line in commands:
        short = [] if line.startswith("colony map") else ["--duration", "1"]
        assert colony(*line.split()[1:], *short).code == 0, line


def test_the_python_block_says_what_it_gives(folder: Path) -> None:
    named: dict[str, Any] = {}
    exec(BLOCKS["python"], named)
    said = [
        line.split("  # ") for line in BLOCKS["python"].splitlines() if line.startswith(("office.", "round"))
    ]
    assert len(said) == 4
    for expression, value in said:
        assert repr(eval(expression, named)) == value


def test_numbers_are_the_readers() -> None:
    assert f"from {keys.MIN_CELL_M:g} to {keys.MAX_CELL_M:g}" in PAGE
    assert f"at most {keys.MAX_DEPTH} deep" in PAGE
    assert (
        f"from -{keys.MAX_COORDINATE_M:g} to {keys.MAX_COORDINATE_M:g} ({keys.MAX_COORDINATE_M / 1000:g} km)"
        in PAGE
    )
    assert f"at most {keys.MAX_DOCKS:,} of them" in PAGE
    assert f"at most {MAX_IMAGE_BYTES >> 20} MiB" in PAGE
    assert f"at most {MAX_YAML_BYTES >> 10} KiB" in PAGE
    sizes = f"at most {MAX_CELLS:,} cells, {MAX_SIDES:,} sides between occupied and other cells"
    sizes += f", and {MAX_WALLS:,} walls"
    assert sizes in PAGE
    assert sizes in (ROOT / "docs" / "errors.md").read_text(encoding="utf-8")
    assert all(name in PAGE for name in FORMATS.values())
