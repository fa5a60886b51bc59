"""The pages of the simulator have the tables, numbers and pictures of the code."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from colony.body.devices import AccelerationErrors, BumperSpec, CompassSpec, RangeFinder, TurnErrors
from colony.body.model import DeviceFaults
from colony.body.shipped import shipped_body
from colony.cli.run.also import ALSO_FORM, MAX_OTHERS
from colony.cli.run.options import MAX_MOVERS
from colony.nav.maps.building import load_building
from colony.nav.missions.elevator_calls import ElevatorCall, instructions
from colony.runtime.observe.summary import OtherSummary, _other_line
from colony.sim.cameras.optics import Optics
from colony.sim.hazards.hazards import Hazard, Hazards
from colony.sim.mujoco import model
from colony.sim.world import people
from colony.sim.world.movers import WALK_MM_S
from colony.sim.world.operator import DELAY_S, RIDE_S, STANDSTILL_S
from tests.pages import page_text, page_words, typed
from tests.paths import ROOT
from tests.sim.robots import FRONT_CAMERA

CAMERAS, DEVICES, HAZARDS, PHYSICS = map(page_text, ("cameras.md", "devices.md", "hazards.md", "physics.md"))
PICTURES = re.findall(r"!\[[^]]*\]\((cameras/([^/]+)/(\w+)\.png)\)", CAMERAS)


def value(text: str) -> Any:
    """Return a number, a fraction, or a range of the page."""
    if " to " in text:
        return tuple(float(part) for part in text.split(" to "))
    above, _, below = text.partition("/")
    return float(above) / float(below or 1)


# --- cameras.md --------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", sorted({place for _, place, _ in PICTURES}))
def test_the_pictures_are_what_the_command_draws(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    typed(f"colony sim snapshot msu_engineering_3 --at {place} --hazards 7", monkeypatch)
    for kept, its_place, name in PICTURES:
        if its_place == place:
            one, other = (
                np.asarray(Image.open(p)).astype(int) for p in (ROOT / "docs" / kept, f"{name}.png")
            )
            assert one.shape == other.shape
            assert (np.abs(one - other) <= 1).mean() > 0.999, kept


def test_every_kept_picture_is_shown() -> None:
    kept = {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs" / "cameras").rglob("*.png")}
    assert kept == {picture for picture, _, _ in PICTURES}


def test_the_table_has_all_of_the_optics() -> None:
    told = dict(re.findall(r"^\| `(\w+)` \| ([\d. /]+) \|", CAMERAS, re.MULTILINE))
    assert {name: pytest.approx(value(text)) for name, text in told.items()} == {
        field.name: getattr(Optics(), field.name) for field in fields(Optics)
    }


# --- devices.md --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "type_", [RangeFinder, BumperSpec, TurnErrors, AccelerationErrors, CompassSpec, DeviceFaults]
)
def test_the_page_speaks_of_every_key(type_: type) -> None:
    for field in fields(type_):
        assert re.search(rf"\b{field.metadata['key']}\b", DEVICES), field.name


# --- hazards.md --------------------------------------------------------------------------------------

ROWS = [line.strip("|").split("|") for line in HAZARDS.splitlines() if re.match(r"\| `[A-Z_]+` \| \d", line)]


def test_the_table_has_all_hazards_with_their_streams_and_rates() -> None:
    assert [(name.strip(" `"), int(stream)) for name, stream, *_ in ROWS] == [
        (h.name, int(h)) for h in Hazard
    ]
    told = dict(re.findall(r"`([a-z_]+)` ([\d./]+(?: to [\d.]+)?)", " ".join(row[-1] for row in ROWS)))
    expected = {f.name: getattr(Hazards(), f.name) for f in fields(Hazards) if f.name != "on"}
    assert {name: value(text) for name, text in told.items()} == expected


# --- physics.md --------------------------------------------------------------------------------------


def _row(name: str) -> str:
    [row] = [line for line in PHYSICS.splitlines() if line.startswith(f"| {name}")]
    return row


def test_the_constants_are_those_of_the_model() -> None:
    build = model.build_of(shipped_body("amr"))
    assert f"| {model.DENSITY_KG_M3:g} kg/m³ | {build.mass:.0f} kg for `amr`" in _row("hull | ")
    assert f"radius {model.MAX_WHEEL_RADIUS_M * 1e3:g} mm" in _row("wheels | ")
    assert f"friction {model.TIRE_FRICTION:g}, " in _row("tires | ")
    assert f"friction {model.HULL_FRICTION:g} " in _row("hull on walls | ")
    assert f"{model.TRACTION * 100:g} % of what the tires hold" in _row("motors | ")
    assert f"settles in {model.SETTLING_S * 1e3:g} ms" in _row("controller of the motors | ")
    assert f"{model.ROTOR_KG_M2:g} kg m²" in _row("rotors | ")
    assert f"{model.LIFT_KG:g} kg and its load" in _row("lift | ")
    assert f"in steps of {model.TIMESTEP_S * 1e3:g} ms" in PHYSICS


def test_the_targets_are_those_of_the_benchmark() -> None:
    text = (ROOT / "benchmarks" / "physics.py").read_text(encoding="utf-8")
    for row, name in (
        ("distance, the worst of ten drives", "WAY_PERCENT"),
        ("heading, the most", "HEADING_DEG"),
    ):
        target = float(_row(row).split("|")[3].split()[0])
        assert f"TARGET_{name} = {target}" in text


# --- simulation.md and missions.md -------------------------------------------------------------------


def test_the_line_of_the_summary_is_as_it_is_written() -> None:
    first = OtherSummary(name="rome", robot="rome", behavior="wander", bumps=0, distance_mm=29_300.0)
    unread = ("teleop_turn", "teleop_velocity")
    second = replace(first, name="rome_2", behavior="teleop", distance_mm=0.0, unread=unread)
    assert f"```text\n{_other_line(first)}\n{_other_line(second)}\n```" in page_text("simulation.md")


def test_the_question_at_the_terminal_is_the_one_on_the_page() -> None:
    building = load_building(ROOT / "maps" / "msu_engineering_3.stickrep")
    call = ElevatorCall("acs.elev.L", "msu_engineering_3", "msu_engineering_2")
    assert instructions(building, call) in page_text("missions.md")


# --- numbers -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("cameras.md", f"{FRONT_CAMERA.above_floor_mm:g} mm above the floor"),
        ("cameras.md", f"image is {FRONT_CAMERA.width} by"),
        ("cameras.md", f"every {Hazards().black_poster_spacing_mm / 1000:g} m of wall"),
        ("cameras.md", f"notice on every {Hazards().poster_spacing_mm / 1000:g} m"),
        ("cameras.md", f"sign on every {Hazards().extinguisher_spacing_mm / 1000:g} m"),
        ("hazards.md", f"less than {people._NOTICE_MM / 1000:g} m ahead"),
        ("hazards.md", f"with probability {people._STOPPING:g},"),
        ("hazards.md", f"for 1 to {people.LONGEST_STOP_S:g} s"),
        ("hazards.md", f"pass at {people._PASSING_MM / 1000:g} m"),
        ("hazards.md", f"or {people._TIGHT_MM / 1000:g} m where"),
        ("hazards.md", f"within {people._BLOCKED_S:g} s turns"),
        ("hazards.md", f"nearer than {people._BERTH_MM:g} mm"),
        ("missions.md", f"{DELAY_S[0]:g} to {DELAY_S[1]:g} s |"),
        ("missions.md", f"{RIDE_S[0]:g} to {RIDE_S[1]:g} s |"),
        ("missions.md", f"for {STANDSTILL_S:g} s"),
        ("simulation.md", f"at most {MAX_MOVERS}"),
        ("simulation.md", "at {:g} to {:g} m/s".format(*(speed / 1000.0 for speed in WALK_MM_S))),
        ("simulation.md", f"for up to {people.LONGEST_STOP_S:g} s"),
        ("simulation.md", f"`--also {ALSO_FORM}`"),
        ("simulation.md", {100: "up to a hundred"}[MAX_OTHERS]),
    ],
)
def test_the_page_has_the_number_of_the_code(page: str, words: str) -> None:
    assert words in page_words(page)
