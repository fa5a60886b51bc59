from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from colony.nav.maps.stickrep.model import Pose
from colony.vision.detections import PlateReading
from colony.vision.level_camera import SIDE
from colony.vision.plates.observations import PlateObservation
from colony.vision.plates.search import DROP_MM, PlateTracks

WALL_MM = 1500.0
STEP_NS, STEP_MM = 250_000_000, 125.0


def observations(
    robot: Pose, places: Sequence[float], t_ns: int, scale: float = 1.0
) -> list[PlateObservation]:
    """What a robot that goes north sees of plates at these places on the wall in the west, `scale` times as
    far away as they are."""
    found = []
    for place in places:
        axis = robot.heading_deg + 90.0
        dx, dy = -WALL_MM, place - robot.y_mm
        bearing = math.remainder(math.degrees(math.atan2(-dx, dy)) - axis, 360.0)
        depth = math.hypot(dx, dy) * math.cos(math.radians(bearing))
        if abs(bearing) < 25.0:
            found.append(
                PlateObservation(t_ns, robot, axis, bearing, scale * depth, 0.0, 1.0, PlateReading("", 0.0))
            )
    return found


def passed(tracks: PlateTracks, places: Sequence[float], *, start: float = -1500.0, steps: int = 32) -> None:
    for step in range(steps):
        robot = Pose(0.0, start + step * STEP_MM, 0.0)
        tracks.update(step * STEP_NS, robot, observations(robot, places, step * STEP_NS))


def test_each_plate_is_one_track() -> None:
    tracks = PlateTracks(SIDE)
    passed(tracks, [0.0, 900.0])
    assert len(tracks.tracks) == 2
    for track, place in zip(tracks.tracks, (0.0, 900.0), strict=True):
        assert track.place.tolist() == pytest.approx([-WALL_MM, place], abs=1.0)
        assert (track.misses, track.hit_fraction) == (0, 1.0)
        assert track.evidence == track.count > 5
        assert track.drift == pytest.approx(0.0, abs=0.01)


def test_what_is_of_another_size_seems_to_move() -> None:
    tracks = PlateTracks(SIDE)
    for step in range(12):
        robot = Pose(0.0, -700.0 + step * STEP_MM, 0.0)
        tracks.update(step * STEP_NS, robot, observations(robot, [0.0], step * STEP_NS, scale=1.4))
    assert max(abs(track.drift) for track in tracks.tracks) == pytest.approx(0.4, abs=0.05)


def test_what_should_be_in_the_image_and_is_not_is_missed() -> None:
    tracks = PlateTracks(SIDE)
    robot = Pose(0.0, 0.0, 0.0)
    tracks.update(0, robot, observations(robot, [0.0], 0))
    for step in range(1, 4):
        tracks.update(step * STEP_NS, robot, [])
    (track,) = tracks.tracks
    assert (track.misses, track.hit_fraction) == (3, 0.25)
    tracks.update(4 * STEP_NS, robot, [])
    assert len(tracks.tracks) == 0  # for good


def test_what_is_out_of_view_is_not_missed() -> None:
    tracks = PlateTracks(SIDE)
    passed(tracks, [0.0])
    (track,) = tracks.tracks
    assert not tracks.is_in_view(track)
    assert track.misses == 0


def test_a_plate_is_forgotten_far_away() -> None:
    tracks = PlateTracks(SIDE)
    passed(tracks, [0.0])
    assert len(tracks.tracks) == 1
    tracks.update(100 * STEP_NS, Pose(0.0, DROP_MM + 100.0, 0.0), [])
    assert len(tracks.tracks) == 0


@pytest.mark.parametrize(
    "jump", [(250.0, -400.0, 0.0), (0.0, 900.0, 0.0), (0.0, 0.0, 30.0), (-90.0, 60.0, -9.0)]
)
def test_a_corrected_position_makes_no_new_plates(jump: tuple[float, float, float]) -> None:
    tracks = PlateTracks(SIDE)
    robot = Pose(0.0, -200.0, 0.0)
    for step in range(4):
        tracks.update(step * STEP_NS, robot, observations(robot, [0.0], step * STEP_NS))
    # Another client corrects the robot's position; the view is the same.
    other = Pose(robot.x_mm + jump[0], robot.y_mm + jump[1], robot.heading_deg + jump[2])
    (look,) = observations(robot, [0.0], 4 * STEP_NS)
    moved = look._replace(robot=other, axis_deg=look.axis_deg + jump[2])
    tracks.update(4 * STEP_NS, other, [moved])
    (track,) = tracks.tracks
    assert len(track.observations) == 5
    assert abs(track.drift) < 0.15


def test_two_plates_side_by_side_are_two() -> None:
    tracks = PlateTracks(SIDE)
    passed(tracks, [0.0, 420.0])
    assert len(tracks.tracks) == 2
