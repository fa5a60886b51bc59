"""Hazards: drawn at their rates, each from a stream of its own, and the same again from the same seed."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.walls import walls_of
from colony.sim.compiled import Floats2
from colony.sim.hazards.hazards import Hazard, Hazards, draw
from colony.sim.hazards.premises import premises_of
from colony.sim.hazards.scenery import Scenery
from tests.buildings import HALLWAY, LOOP, MSU

RUNS = 400
PREMISES = premises_of(MSU)

PARTS = {
    Hazard.SLIP: ("joints", "slip"),
    Hazard.GLASS: ("glass",),
    Hazard.LIGHTS: ("lights",),
    Hazard.SUN: ("sun",),
    Hazard.PEOPLE: ("people",),
    Hazard.DOORS: ("doors",),
    Hazard.CROSS_TALK: ("cross_talk",),
    Hazard.ENCODERS: ("encoder_scale",),
    Hazard.COMPASS: ("compass_disturbance",),
    Hazard.POSTERS: ("posters", "extinguishers"),
}
"""What of a scenery comes from which hazard."""


@cache
def sceneries() -> list[Scenery]:
    return [draw(Hazards(), MSU, seed) for seed in range(RUNS)]


def assert_rate(found: int, trials: int, rate: float) -> None:
    """Within four standard deviations of a binomial."""
    assert abs(found - trials * rate) <= 4.0 * math.sqrt(trials * rate * (1.0 - rate)), (found, trials, rate)


def count(of: str) -> int:
    return sum(len(getattr(scenery, of)) for scenery in sceneries())


def same(one: Scenery, other: Scenery, part: str) -> bool:
    return bool(np.array_equal(getattr(one, part), getattr(other, part)))


# --- rates ---------------------------------------------------------------------------------------


def test_doors_stand_open_at_their_rate_and_at_all_angles() -> None:
    assert_rate(count("doors"), RUNS * len(PREMISES.rooms), 0.12)
    angles = [door.angle_deg for scenery in sceneries() for door in scenery.doors]
    assert 30.0 <= min(angles) < 31.0
    assert 89.0 < max(angles) <= 90.0


def test_most_doors_of_the_building_can_be_opened() -> None:
    doors = sum(kind.name == "DOOR" for kind in walls_of(MSU).kinds)
    assert len(PREMISES.rooms) >= 0.9 * doors


def test_glass_is_silent_at_its_rate_and_nothing_else_is() -> None:
    assert PREMISES.glass
    assert_rate(count("glass"), RUNS * len(PREMISES.glass), 0.8)
    for scenery in sceneries():
        assert scenery.silent.sum() == len(scenery.glass)
        assert not {door.edge for door in scenery.doors} & set(PREMISES.glass)


def test_lights_are_out_or_dim_at_their_rates() -> None:
    brightness = [light.brightness for scenery in sceneries() for light in scenery.lights]
    assert set(brightness) == {0.0, 1.0 / 3.0, 1.0}
    assert_rate(brightness.count(0.0), len(brightness), 0.05)
    assert_rate(brightness.count(1.0 / 3.0), len(brightness), 0.05)


def test_corridors_are_sunlit_at_their_rate() -> None:
    lengths = {round(track.length_mm, 3) for track in PREMISES.tracks}
    assert len(lengths) == len(PREMISES.tracks)  # so that a corridor is known by its length
    lit = sum(round(band.length_mm, 3) in lengths for scenery in sceneries() for band in scenery.sun)
    assert_rate(lit, RUNS * len(PREMISES.tracks), 0.1)


def test_there_is_a_person_for_every_forty_meters_of_corridor() -> None:
    meters = sum(track.length_mm for track in PREMISES.tracks) / 1000.0
    expected = RUNS * meters / 40.0
    assert abs(count("people") - expected) < 4.0 * math.sqrt(expected)
    people = [person for scenery in sceneries() for person in scenery.people]
    assert min(person.speed_mm_s for person in people) >= 600.0
    assert max(person.speed_mm_s for person in people) <= 1400.0
    assert 0.45 < sum(person.forward for person in people) / len(people) < 0.55


def test_joints_are_where_wings_meet_and_one_for_every_sixty_meters() -> None:
    meters = sum(track.length_mm for track in PREMISES.tracks) / 1000.0
    assert len(PREMISES.wing_joints) >= 2
    for scenery in sceneries()[:20]:
        assert scenery.joints[: len(PREMISES.wing_joints)] == PREMISES.wing_joints
        assert abs(len(scenery.joints) - len(PREMISES.wing_joints) - meters / 60.0) <= 1.0
    assert premises_of(LOOP).wing_joints == ()


def test_encoder_scales_have_a_standard_deviation_of_one_percent() -> None:
    errors = np.array([scenery.encoder_scale - 1.0 for scenery in sceneries()])
    assert abs(errors.mean()) < 4.0 * 0.01 / math.sqrt(RUNS)
    assert abs(errors.std() - 0.01) < 4.0 * 0.01 / math.sqrt(2 * RUNS)


# --- independence --------------------------------------------------------------------------------


@pytest.mark.parametrize("floor", [LOOP, HALLWAY, MSU], ids=lambda floor: floor.name)
def test_the_same_seed_gives_the_same_scenery_and_another_one_another(floor: Map) -> None:
    one, again, other = (draw(Hazards(), floor, seed) for seed in (5, 5, 6))
    for field in fields(Scenery):
        assert same(one, again, field.name), field.name
    assert one.encoder_scale != other.encoder_scale


@pytest.mark.parametrize("hazard", Hazard, ids=lambda hazard: hazard.name)
def test_switching_a_hazard_off_changes_no_other(hazard: Hazard) -> None:
    calm = draw(Hazards.none(), MSU, 11)
    every, without = draw(Hazards(), MSU, 11), draw(Hazards().without(hazard), MSU, 11)
    alone = draw(Hazards().only(hazard), MSU, 11)
    for other, parts in PARTS.items():
        for part in parts:
            if other is hazard:
                assert same(without, calm, part)
                assert same(alone, every, part)
            else:
                assert same(without, every, part)
                assert same(alone, calm, part)


@pytest.mark.parametrize(
    "change",
    [
        {"open_door": 0.5},
        {"person_spacing_mm": 10_000.0},
        {"light_out": 0.5},
        {"sunlit": 1.0},
        {"glass": 0.0},
    ],
    ids=lambda change: next(iter(change)),
)
def test_changing_a_rate_changes_no_other_hazard(change: dict[str, float]) -> None:
    befallen = {"open_door": "doors", "person_spacing_mm": "people", "light_out": "lights"}
    befallen |= {"sunlit": "sun", "glass": "glass"}
    every, changed = draw(Hazards(), MSU, 12), draw(replace(Hazards(), **change), MSU, 12)  # type: ignore[arg-type]
    for parts in PARTS.values():
        for part in parts:
            assert same(every, changed, part) == (part != befallen[next(iter(change))])


def test_a_higher_rate_opens_more_doors_and_shuts_none() -> None:
    few, many = (draw(Hazards(open_door=rate), MSU, 3) for rate in (0.1, 0.6))
    assert set(few.doors) < set(many.doors)


def test_without_hazards_a_building_is_its_map() -> None:
    calm = draw(Hazards.none(), MSU, 1)
    assert (calm.walls == walls_of(MSU).segments).all()
    assert not calm.silent.any()
    assert all(light.brightness == 1.0 for light in calm.lights)


# --- geometry ------------------------------------------------------------------------------------


@pytest.mark.parametrize("floor", [LOOP, MSU], ids=lambda floor: floor.name)
def test_open_doors_change_nothing_in_the_corridors(floor: Map) -> None:
    every = draw(Hazards(on=frozenset({Hazard.DOORS}), open_door=1.0), floor, 1)
    walls = walls_of(floor).segments
    shut = {tuple(wall) for wall in walls.tolist()}
    added = np.array([wall for wall in every.walls.tolist() if tuple(wall) not in shut])
    assert len(added) >= 5 * len(every.doors) > 0
    parts = np.linspace(0.01, 0.99, 25)[:, None, None]
    points = (added[:, :2] + parts * (added[:, 2:] - added[:, :2])).reshape(-1, 2)
    corridor = _free(walls, points) & (_distance(walls, points) > 1.0)
    assert not corridor.any()


def _free(walls: Floats2, points: Floats2) -> NDArray[np.bool_]:
    """Which points are in free space: an odd number of walls lies to their east."""
    x0, y0, x1, y1 = walls.T[:, :, None]
    x, y = points.T
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = x0 + (y - y0) / (y1 - y0) * (x1 - x0)
    return np.asarray((((y0 > y) != (y1 > y)) & (x < crossing)).sum(axis=0) % 2 == 1)


def _distance(walls: Floats2, points: Floats2) -> Floats2:
    start, along = walls[:, None, :2] - points, walls[:, None, 2:] - walls[:, None, :2]
    part = np.clip(-(start * along).sum(axis=2) / (along * along).sum(axis=2), 0.0, 1.0)
    return np.asarray(np.hypot(*np.moveaxis(start + part[:, :, None] * along, 2, 0)).min(axis=0))


def test_lights_lie_across_their_corridor() -> None:
    for light in PREMISES.lights:
        nearest = min(PREMISES.tracks, key=lambda t: abs(t.coordinates(light.x_mm, light.y_mm)[1]))
        if abs(nearest.coordinates(light.x_mm, light.y_mm)[1]) < 100.0:
            across = [t for t in PREMISES.tracks if abs(t.coordinates(light.x_mm, light.y_mm)[1]) < 100.0]
            assert light.heading_deg in {t.heading_deg for t in across}


# --- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        {"slip": 1.5},
        {"glass": -0.1},
        {"light_out": math.nan},
        {"light_out": 0.6, "light_dim": 0.6},
        {"walk_mm_s": (1400.0, 600.0)},
        {"person_spacing_mm": 0.0},
        {"joint_spacing_mm": math.inf},
        {"door_deg": (30.0, 120.0)},
        {"door_deg": (30.0,)},
        {"slip_loss_mm": (1.0, 2.0, 3.0)},
        {"dim_brightness": 1.5},
        {"compass_deg": 181.0},
    ],
    ids=lambda change: next(iter(change)),
)
def test_rates_that_make_no_sense_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"expected"):
        Hazards(**change)  # type: ignore[arg-type]


def test_a_seed_below_zero_is_refused() -> None:
    with pytest.raises(ValueError, match=r"the seed of a scenery is -3; expected 0 or more"):
        draw(Hazards(), LOOP, -3)


def test_a_scenery_shares_nothing_with_the_map_that_programs_read() -> None:
    """So no program that holds the map's walls can see which doors are open."""
    scenery, known = draw(Hazards(), MSU, 5), walls_of(MSU).segments
    assert len(scenery.walls) > len(known)
    for kept in (scenery.walls, scenery.silent, PREMISES.walls):
        assert not kept.flags.writeable
        assert not np.shares_memory(kept, known) or (kept == known).all()
