"""docs/cameras.md: its command prints what is shown, its program runs, its pictures are what the command
draws, and its numbers are those of the code."""

from __future__ import annotations

import re
import shutil
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from colony.sim.cameras.optics import Optics
from colony.sim.hazards.hazards import Hazards
from tests.pages import COMMANDS, typed
from tests.paths import ROOT
from tests.sim.robots import FRONT_CAMERA

PAGE = (ROOT / "docs" / "cameras.md").read_text(encoding="utf-8")
PICTURES = re.findall(r"!\[[^]]*\]\((cameras/([^/]+)/(\w+)\.png)\)", PAGE)


def test_the_command_prints_what_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROOT / "maps", tmp_path / "maps")
    monkeypatch.chdir(tmp_path)
    [(command, shown)] = COMMANDS.findall(PAGE)
    assert typed(command.strip(), monkeypatch) == shown


@pytest.mark.parametrize("place", sorted({place for _, place, _ in PICTURES}))
def test_the_pictures_are_what_the_command_draws(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = ROOT / "maps" / "msu_engineering_3.stickrep"
    typed(f"colony sim snapshot {path} --at {place} --hazards 7 -o {tmp_path}", monkeypatch)
    for kept, its_place, name in PICTURES:
        if its_place == place:
            one, other = (
                np.asarray(Image.open(p)).astype(int)
                for p in (ROOT / "docs" / kept, tmp_path / f"{name}.png")
            )
            assert one.shape == other.shape
            assert (np.abs(one - other) <= 1).mean() > 0.999, kept


def test_every_kept_picture_is_shown() -> None:
    kept = {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs" / "cameras").rglob("*.png")}
    assert kept == {picture for picture, _, _ in PICTURES}


def test_the_program_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    [program] = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    exec(program, names)
    assert (names["band"] == names["image"][40:80]).all()
    assert names["large"].shape == (480, 640)
    assert names["exact"].shape == (120, 240)


def test_the_table_has_all_of_the_optics() -> None:
    told = dict(re.findall(r"^\| `(\w+)` \| ([\d. /]+) \|", PAGE, re.MULTILINE))
    assert set(told) == {field.name for field in fields(Optics)}
    for name, text in told.items():
        above, _, below = text.partition("/")
        assert float(above) / float(below or 1) == pytest.approx(getattr(Optics(), name)), name


@pytest.mark.parametrize(
    ("words", "value"),
    [
        ("{} mm above the\nfloor", FRONT_CAMERA.above_floor_mm),
        ("image is {} by", FRONT_CAMERA.width),
        ("every {} m of wall", Hazards().black_poster_spacing_mm / 1000),
        ("notice on every {} m", Hazards().poster_spacing_mm / 1000),
        ("sign on every {} m", Hazards().extinguisher_spacing_mm / 1000),
    ],
)
def test_the_text_has_the_numbers_of_the_code(words: str, value: float) -> None:
    plain, wanted = " ".join(PAGE.split()), " ".join(words.split())
    before, _, after = wanted.partition("{}")
    found = re.search(re.escape(before) + r"([\d.]+)" + re.escape(after), plain)
    assert found is not None, words
    assert float(found[1]) == value
