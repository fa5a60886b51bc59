"""The hazards of a building and their rates, each with its own switch and random stream.

    scenery = draw(Hazards(), floor, seed=7)
    world = World(walls=scenery, poses=[floor.start], seed=7)

The rates are those of docs/hazards.md; they were fixed before any program was tuned against them. Each hazard
draws from its own stream, for every candidate in the order of the map, so that switching one off, or changing
its rate, does not change the others.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.world_map import WorldMap
from colony.sim.cameras.furnishing import Spacings, draw_furnishings
from colony.sim.cameras.rooms import open_door_segments
from colony.sim.compiled import Floats2
from colony.sim.hazards.premises import Premises, premises_of
from colony.sim.hazards.scenery import (
    NO_SLIP,
    CeilingLight,
    CompassDisturbance,
    CorridorTrack,
    ExpansionJoint,
    Extinguisher,
    OpenDoor,
    Person,
    Poster,
    Scenery,
    SunBand,
    WheelSlip,
    bare_scenery,
)

_OFFSET_FRACTION = 0.6  # maximum preferred offset of people, as a fraction of the half width
_SUN_LEVEL = 45.0  # excess of the ceiling of a sunlit corridor, in gray levels
_BAND_LEVEL = 60.0  # additional excess before a window
_BAND_SPACING_MM = (4000.0, 8000.0)
_BAND_MM = (800.0, 2500.0)


_UPPER_LIMITS = dict.fromkeys(("slip", "glass", "light_out", "light_dim", "dim_brightness", "sunlit"), 1.0)
_UPPER_LIMITS |= {
    "poster_on_door": 1.0,
    "open_door": 1.0,
    "cross_talk": 1.0,
    "door_deg": 90.0,
    "compass_deg": 180.0,
}
"""Upper limits of the numbers of `Hazards` that have one."""


class Hazard(IntEnum):
    """A kind of hazard; the value is the number of its random stream, and never changes."""

    SLIP = 0
    GLASS = 1
    LIGHTS = 2
    SUN = 3
    PEOPLE = 4
    DOORS = 5
    CROSS_TALK = 6
    ENCODERS = 7
    COMPASS = 8
    POSTERS = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class Hazards:
    """The hazards and their rates; lengths in mm, angles in degrees, times in seconds.

    Attributes:
        on: the hazards that are switched on.
        slip: the probability that wheels slip when a robot's center crosses a metal expansion joint.
        slip_turn_deg: the standard deviation of the robot's turn in a slip.
        slip_loss_mm: the range of the length by which wheels spin.
        joint_spacing_mm: length of corridor per joint, in addition to the joints between wings.
        glass: the probability that sonar and infrared do not detect a glass door in this run.
        light_out, light_dim: the probabilities that a light is out or dim.
        dim_brightness: the brightness of a dim light.
        sunlit: the probability that the sun lights the ceiling of a corridor.
        person_spacing_mm: mean length of corridor per person.
        walk_mm_s: the range of people's walking speed.
        open_door: the probability that a door is open.
        door_deg: the range of the angle of an open door.
        cross_talk: the probability that a sonar reading is false.
        encoder_scale: the standard deviation of a scale factor common to both wheels.
        compass_deg: the maximum error of the compass.
        black_poster_spacing_mm, poster_spacing_mm, extinguisher_spacing_mm: mean length of wall per black
            poster, other poster, and fire extinguisher.
        poster_on_door: the probability that a black poster hangs on a door.

    Raises:
        ValueError: a number is not finite or out of range, or a range is reversed.
    """

    on: frozenset[Hazard] = frozenset(Hazard)
    slip: float = 0.25
    slip_turn_deg: float = 10.0
    slip_loss_mm: tuple[float, float] = (30.0, 80.0)
    joint_spacing_mm: float = 60_000.0
    glass: float = 0.8
    light_out: float = 0.05
    light_dim: float = 0.05
    dim_brightness: float = 1.0 / 3.0
    sunlit: float = 0.1
    person_spacing_mm: float = 40_000.0
    walk_mm_s: tuple[float, float] = (600.0, 1400.0)
    open_door: float = 0.12
    door_deg: tuple[float, float] = (30.0, 90.0)
    cross_talk: float = 0.005
    encoder_scale: float = 0.01
    compass_deg: float = 60.0
    black_poster_spacing_mm: float = 80_000.0
    poster_spacing_mm: float = 15_000.0
    extinguisher_spacing_mm: float = 25_000.0
    poster_on_door: float = 0.02

    def __post_init__(self) -> None:
        """Check the ranges of the rates."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "on":
                continue
            is_range = isinstance(field.default, tuple)
            numbers = tuple(value) if is_range else (value,)
            upper = _UPPER_LIMITS.get(field.name, math.inf)
            is_valid = len(numbers) == 1 + is_range and all(
                0.0 <= n <= upper and math.isfinite(n) for n in numbers
            )
            if not is_valid or list(numbers) != sorted(numbers):
                expected = "of at least 0" if upper == math.inf else f"from 0 to {upper:g}"
                number = "two finite numbers, the lower one first," if is_range else "a finite number"
                raise ValueError(f"Hazards.{field.name} is {value!r}; expected {number} {expected}")
        if self.light_out + self.light_dim > 1.0:
            found = f"light_out and light_dim are {self.light_out} and {self.light_dim}"
            raise ValueError(f"{found}; expected a sum of at most 1")
        spacings = [field.name for field in fields(self) if field.name.endswith("_spacing_mm")]
        if min(getattr(self, name) for name in spacings) <= 0.0:
            raise ValueError(
                f"{', '.join(spacings)}: expected more than 0; use Hazards.without to switch a hazard off"
            )

    @staticmethod
    def none() -> Hazards:
        """Return hazards that are all switched off."""
        return Hazards(on=frozenset())

    def without(self, *hazards: Hazard) -> Hazards:
        """Return these hazards with the given ones switched off."""
        return replace(self, on=self.on - frozenset(hazards))

    def only(self, *hazards: Hazard) -> Hazards:
        """Return these hazards with all others switched off."""
        return replace(self, on=self.on & frozenset(hazards))


def draw(hazards: Hazards, floor: Map, seed: int) -> Scenery:
    """Draw the scenery of a floor from a seed.

    Floors with the same seed have the same draws, such as lights with the same numbers out. Give each floor
    of a building its own seed.

    Raises:
        ValueError: the seed is below 0.
    """
    if seed < 0:
        raise ValueError(f"the seed of a scenery is {seed}; expected 0 or more")
    premises = premises_of(floor)
    glass, doors = _glass(hazards, premises, seed), _doors(hazards, premises, seed)
    posters, extinguishers = _furnishings(hazards, floor, seed)
    walls, silent = _walls(premises, glass, doors)
    return Scenery(
        seed=seed,
        walls=walls,
        silent=silent,
        doors=tuple(door for door, _ in doors),
        glass=glass,
        lights=_lights(hazards, premises, seed),
        sun=tuple(_sun(hazards, premises, seed)),
        people=tuple(_people(hazards, premises, seed)),
        joints=_joints(hazards, premises, seed),
        slip=_slip(hazards),
        cross_talk=hazards.cross_talk if Hazard.CROSS_TALK in hazards.on else 0.0,
        encoder_scale=_encoder_scale(hazards, seed),
        compass_disturbance=_compass_disturbance(hazards, seed),
        posters=posters,
        extinguishers=extinguishers,
        holes=tuple(np.array(hole.corners()) for hole in floor.holes),
        docks=floor.docks,
    )


def scenery_of(world: WorldMap, hazards: Hazards, seed: int) -> Scenery:
    """Return the scenery of a world: with the hazards that are drawn from the seed in a building.

    Raises:
        DiagnosticError: a grid is to have hazards, which require a building.
    """
    if isinstance(world.source, Map):
        return draw(hazards, world.source, seed)
    if hazards.on:
        world.building("--hazards")
    scenery = bare_scenery(world.walls, seed=seed, outlines=world.has_outlines)
    return replace(scenery, holes=world.holes, docks=world.docks)


def _stream(seed: int, hazard: Hazard, item: int = 0) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(hazard), item)))


def _glass(hazards: Hazards, premises: Premises, seed: int) -> tuple[int, ...]:
    draws = _stream(seed, Hazard.GLASS).random(len(premises.walls))
    is_undetected = (
        draws < hazards.glass if Hazard.GLASS in hazards.on else np.zeros(len(draws), dtype=np.bool_)
    )
    return tuple(edge for edge in premises.glass if is_undetected[edge])


def _doors(hazards: Hazards, premises: Premises, seed: int) -> list[tuple[OpenDoor, bool]]:
    """Draw the open doors; the flag is True if a door's hinge is at its start."""
    draws = _stream(seed, Hazard.DOORS).random((len(premises.walls), 3)).tolist()
    low, high = hazards.door_deg
    return [
        (OpenDoor(edge=edge, angle_deg=low + draws[edge][1] * (high - low)), draws[edge][2] < 0.5)
        for edge in premises.rooms
        if Hazard.DOORS in hazards.on and draws[edge][0] < hazards.open_door
    ]


def _walls(
    premises: Premises, glass: tuple[int, ...], doors: list[tuple[OpenDoor, bool]]
) -> tuple[Floats2, NDArray[np.bool_]]:
    """Return the solid segments, edge by edge, and a mask of the silent ones."""
    open_doors = {door.edge: (door.angle_deg, hinge_first) for door, hinge_first in doors}
    rows: list[tuple[float, ...]] = []
    silent: list[bool] = []
    for edge, wall in enumerate(premises.walls.tolist()):
        segments = (
            open_door_segments(premises.rooms[edge], *open_doors[edge])
            if edge in open_doors
            else [tuple(wall)]
        )
        rows += segments
        silent += [edge in glass] * len(segments)
    walls, mask = np.array(rows, dtype=np.float64).reshape(-1, 4), np.array(silent, dtype=np.bool_)
    walls.flags.writeable = mask.flags.writeable = False
    return walls, mask


def _lights(hazards: Hazards, premises: Premises, seed: int) -> tuple[CeilingLight, ...]:
    draws = _stream(seed, Hazard.LIGHTS).random(len(premises.lights)).tolist()
    if Hazard.LIGHTS not in hazards.on:
        return premises.lights
    out, dim = hazards.light_out, hazards.light_out + hazards.light_dim
    brightness = [0.0 if u < out else hazards.dim_brightness if u < dim else 1.0 for u in draws]
    return tuple(replace(light, brightness=b) for light, b in zip(premises.lights, brightness, strict=True))


def _sun(hazards: Hazards, premises: Premises, seed: int) -> Iterator[SunBand]:
    for number, track in enumerate(premises.tracks):
        rng = _stream(seed, Hazard.SUN, number)
        if rng.random() >= hazards.sunlit or Hazard.SUN not in hazards.on:
            continue
        yield _band(track, 0.0, track.length_mm, _SUN_LEVEL)
        position = rng.uniform(*_BAND_SPACING_MM) / 2
        while position < track.length_mm:
            length = rng.uniform(*_BAND_MM)
            yield _band(track, position, min(position + length, track.length_mm), _BAND_LEVEL)
            position += rng.uniform(*_BAND_SPACING_MM)


def _band(track: CorridorTrack, start: float, end: float, level: float) -> SunBand:
    x, y = track.point_at((start + end) / 2)
    return SunBand(
        x_mm=x, y_mm=y, heading_deg=track.heading_deg,
        length_mm=end - start, width_mm=2 * track.half_width_mm, level=level,
    )  # fmt: skip


def _people(hazards: Hazards, premises: Premises, seed: int) -> Iterator[Person]:
    for number, track in enumerate(premises.walks):
        if track is None or Hazard.PEOPLE not in hazards.on:
            continue
        rng = _stream(seed, Hazard.PEOPLE, number)
        for _ in range(rng.poisson(premises.tracks[number].length_mm / hazards.person_spacing_mm)):
            along, aside, forward, speed = rng.random(4).tolist()
            slowest, fastest = hazards.walk_mm_s
            yield Person(
                track=track,
                along_mm=along * track.length_mm,
                offset_mm=(2.0 * aside - 1.0) * _OFFSET_FRACTION * track.half_width_mm,
                forward=forward < 0.5,
                speed_mm_s=slowest + speed * (fastest - slowest),
            )


def _joints(hazards: Hazards, premises: Premises, seed: int) -> tuple[ExpansionJoint, ...]:
    """Return the joints between the wings, and joints at equal spacing along all corridors, end to end."""
    phase = _stream(seed, Hazard.SLIP).random()
    if Hazard.SLIP not in hazards.on:
        return ()
    joints = list(premises.wing_joints)
    position = phase * hazards.joint_spacing_mm
    for track in premises.tracks:
        while position < track.length_mm:
            joints.append(track.joint(position))
            position += hazards.joint_spacing_mm
        position -= track.length_mm
    return tuple(joints)


def _slip(hazards: Hazards) -> WheelSlip:
    if Hazard.SLIP not in hazards.on:
        return NO_SLIP
    low, high = hazards.slip_loss_mm
    return WheelSlip(probability=hazards.slip, turn_deg=hazards.slip_turn_deg, min_mm=low, max_mm=high)


def _encoder_scale(hazards: Hazards, seed: int) -> float:
    deviate = float(_stream(seed, Hazard.ENCODERS).standard_normal())
    return 1.0 + hazards.encoder_scale * deviate if Hazard.ENCODERS in hazards.on else 1.0


def _furnishings(
    hazards: Hazards, floor: Map, seed: int
) -> tuple[tuple[Poster, ...], tuple[Extinguisher, ...]]:
    if Hazard.POSTERS not in hazards.on:
        return (), ()
    spacings = Spacings(
        black_poster_mm=hazards.black_poster_spacing_mm,
        poster_mm=hazards.poster_spacing_mm,
        extinguisher_mm=hazards.extinguisher_spacing_mm,
        door_poster_probability=hazards.poster_on_door,
    )
    return draw_furnishings(floor, spacings, lambda item: _stream(seed, Hazard.POSTERS, item))


def _compass_disturbance(hazards: Hazards, seed: int) -> CompassDisturbance:
    field_seed = int(_stream(seed, Hazard.COMPASS).integers(2**62))
    return (
        CompassDisturbance(seed=field_seed, max_deg=hazards.compass_deg)
        if Hazard.COMPASS in hazards.on
        else CompassDisturbance()
    )
