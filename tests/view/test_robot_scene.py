"""Pictures of robots, as data."""

from __future__ import annotations

import math

import pytest

from colony.body.model import Body
from colony.body.reader import body_of_text, read_body
from colony.dsl.load import load_file, load_text
from colony.view.polar import PicturePoint, Sector
from colony.view.robot_scene import Beam, RobotScene, SensorView, Wheel, robot_scene
from tests.body.test_disagreements import BODY, INTERFACE
from tests.body.test_sensors import BODY as SENSORS_BODY
from tests.body.test_sensors import INTERFACE as SENSORS_INTERFACE
from tests.paths import ROOT


def scene(interface: str = INTERFACE, body: str = BODY) -> RobotScene:
    return robot_scene(load_text(interface).robot, body_of(body))


def body_of(text: str) -> Body:
    found = body_of_text(text, "small.toml").body
    assert found is not None
    return found


def rome() -> RobotScene:
    folder = ROOT / "robots" / "rome"
    body = read_body(folder / "rome.toml").body
    assert body is not None
    return robot_scene(load_file(folder / "rome.colony").robot, body)


def sensor(of: RobotScene, name: str) -> SensorView:
    return next(s for s in of.sensors if s.name == name)


def near(found: PicturePoint, x: float, y: float) -> bool:
    return math.dist(found, (x, y)) < 1e-6


def test_elements_begin_at_their_transducers() -> None:
    sonar = sensor(rome(), "sonar")
    assert sonar.note == "24 elements, 10 m"
    ahead, left = sonar.beams[12], sonar.beams[18]
    assert near(ahead.origin, 0.0, 360.0)
    assert near(left.origin, -360.0, 0.0)
    assert (ahead.sector, ahead.reach_mm) == (Sector(-12.0, 12.0), 10_000.0)
    infrared = sensor(rome(), "infrared").beams[18]
    assert infrared.sector.width == 0.0
    assert infrared.outline(9e9)[1].x == pytest.approx(-1120.0)


def test_cameras_reach_as_far_as_the_picture() -> None:
    side = sensor(rome(), "CServerSide")
    assert side.note == "camera, 60°"
    [beam] = side.beams
    assert (beam.sector, beam.reach_mm) == (Sector(60.0, 120.0), None)
    assert max(math.hypot(*corner) for corner in beam.outline(500.0)) == pytest.approx(500.0)
    assert rome().lines == ("looks up: CServerUp",)
    assert rome().farthest_mm == 10_000.0


def test_a_base_that_drives_sideways_is_drawn_with_four_wheels() -> None:
    folder = ROOT / "robots" / "omni"
    body = read_body(folder / "omni.toml").body
    assert body is not None
    omni = robot_scene(load_file(folder / "omni.colony").robot, body)
    assert omni.wheels == tuple(Wheel(PicturePoint(x, y), 0.0) for y in (80.0, -80.0) for x in (-90.0, 90.0))


def test_omni_wheels_are_drawn_as_they_roll() -> None:
    wheels = (
        '[["75 mm", "130 mm", "150 deg"], ["-150 mm", "0 mm", "-90 deg"], ["75 mm", "-130 mm", "30 deg"]]'
    )
    old = 'kind = "differential", wheel_base = "30 cm"'
    assert old in BODY
    drawn = scene(body=BODY.replace(old, f'kind = "omnidirectional", wheels = {wheels}')).wheels
    assert drawn[0] == Wheel(PicturePoint(-130.0, 75.0), 150.0)
    assert [wheel.bearing_deg for wheel in drawn] == [150.0, -90.0, 30.0]


def test_a_robot_is_drawn_with_ahead_up() -> None:
    small = scene()
    assert small.radius_mm == 200.0
    assert near(small.footprint[0], 0.0, 200.0)
    assert small.wheels == (Wheel(PicturePoint(-150.0, 0.0), 0.0), Wheel(PicturePoint(150.0, 0.0), 0.0))
    corners = '[["-200 mm", "-150 mm"], ["250 mm", "-150 mm"], ["0 mm", "150 mm"]]'
    round_ = 'shape = "circle", radius = "0.2 m"'
    triangle = scene(body=BODY.replace(round_, f'shape = "polygon", corners = {corners}'))
    assert triangle.footprint == (
        PicturePoint(150.0, -200.0),
        PicturePoint(150.0, 250.0),
        PicturePoint(-150.0, 0.0),
    )
    assert triangle.radius_mm == pytest.approx(math.hypot(250.0, 150.0))


def test_what_the_body_blocks_is_left_out() -> None:
    scan = sensor(scene(), "scan")
    assert len(scan.beams) == 360 - 16 - 29  # 150 to 165 degrees, and 29 to 57
    assert scan.note == f"{len(scan.beams)} of 360 elements, 12 m"
    assert scan.beams[0].origin == PicturePoint(0.0, 50.0)
    assert not [beam for beam in scan.beams if 150.0 <= beam.sector.middle <= 165.0]


def test_without_a_simulated_device_the_interface_says_where_elements_look() -> None:
    device = BODY[BODY.index("simulated.device") : BODY.index("hardware =")]
    scan = sensor(scene(body=BODY.replace(device, "")), "scan")
    assert scan.beams[0].origin == PicturePoint(0.0, 0.0)
    assert scan.beams[0].reach_mm == 12_000.0
    assert scan.beams[0].sector == Sector(-0.5, 0.5)


def test_a_robot_without_sensors_has_a_picture() -> None:
    bare = scene("robot small { sensor bumper : bool from RServer.bumper }")
    assert bare.sensors == ()
    assert bare.farthest_mm == 400.0


def test_sensors_that_look_down_are_marks_at_their_places() -> None:
    folder = ROOT / "robots" / "amr"
    body = read_body(folder / "amr.toml").body
    assert body is not None
    amr = robot_scene(load_file(folder / "amr.colony").robot, body)
    cliff = sensor(amr, "cliff")
    assert cliff.note == "4 elements, downward"
    assert [beam.origin for beam in cliff.beams[:2]] == [
        PicturePoint(-190.0, 330.0),
        PicturePoint(190.0, 330.0),
    ]
    assert {corner for beam in cliff.beams for corner in beam.outline(9e9)} == {
        beam.origin for beam in cliff.beams
    }
    assert amr.farthest_mm == 12_000.0


def test_range_finders_are_drawn_as_cones_at_their_poses() -> None:
    near = sensor(scene(SENSORS_INTERFACE, SENSORS_BODY), "near")
    assert near.note == "3 elements, 1.5 m"
    assert near.beams[1] == Beam(origin=PicturePoint(-90.0, 50.0), sector=Sector(55.0, 65.0), reach_mm=1500.0)


def test_the_sectors_of_a_bumper_are_drawn_around_the_hull() -> None:
    felt = sensor(scene(SENSORS_INTERFACE, SENSORS_BODY), "felt")
    assert felt.note == "2 sectors"
    assert felt.beams[1] == Beam(origin=PicturePoint(0.0, 0.0), sector=Sector(150.0, 210.0), reach_mm=216.0)
