from __future__ import annotations

import pytest

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import Pose
from colony.vision.detections import PlateReading
from colony.vision.plates.observations import MAX_GATE_MM, MIN_GATE_MM, PlateObservation, gate_mm, match_plate


def hung(door: str, y: float, x: float = -1500.0, heading: float = 90.0) -> Plate:
    middle = Point(x, y)
    return Plate(edge=0, start_mm=0.0, end_mm=356.0, center=middle, heading_deg=heading, door=door, text=door)


PLATES = (hung("352", 0.0), hung("354", 2000.0), hung("353", 0.0, x=-1700.0, heading=270.0))
LOOK = PlateObservation(0, Pose(0.0, 0.0, 0.0), 90.0, 0.0, 1500.0, 0.0, 1.0, PlateReading("", 0.0))


def door_at(
    place: tuple[float, float],
    text: str = "",
    confidence: float = 0.0,
    gate: float = 300.0,
    taken: tuple[str, ...] = (),
) -> str | None:
    plate = match_plate(place, LOOK, text, confidence, PLATES, gate=gate, taken=taken)
    return None if plate is None else plate.door


@pytest.mark.parametrize(
    ("place", "door"),
    [
        ((-1500.0, 0.0), "352"),
        ((-1480.0, 250.0), "352"),
        ((-1480.0, 350.0), None),
        ((-1000.0, 0.0), "352"),  # distances are measured less well
        ((-700.0, 0.0), None),
        ((-1500.0, 1800.0), "354"),
    ],
)
def test_a_plate_is_the_one_that_hangs_there(place: tuple[float, float], door: str | None) -> None:
    assert door_at(place) == door


def test_a_plate_on_the_other_side_of_the_wall_is_not_seen() -> None:
    assert door_at((-1700.0, 0.0)) == "352"
    assert door_at((-1700.0, 0.0), "353", 0.99) == "352"  # misread, by so little off


def test_a_sure_reading_decides() -> None:
    assert door_at((-1500.0, 200.0), "999", 0.95) is None
    assert door_at((-1500.0, 200.0), "999", 0.5) == "352"
    assert door_at((-1500.0, 100.0), "999", 0.95) == "352"
    assert door_at((-1500.0, 900.0), "354", 0.95, gate=1200.0) == "354"
    assert door_at((-1500.0, 900.0), gate=1200.0) == "352"


def test_a_plate_that_is_another_one_already_is_not_it() -> None:
    assert door_at((-1500.0, 0.0), taken=("352",)) is None


@pytest.mark.parametrize(
    ("sigma", "gate"), [(10.0, MIN_GATE_MM), (200.0, 600.0), (5000.0, MAX_GATE_MM), (None, 730.0)]
)
def test_the_gate_is_as_wide_as_the_position_is_unsure(sigma: float | None, gate: float) -> None:
    assert gate_mm(sigma) == gate
