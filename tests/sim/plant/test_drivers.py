"""Drivers of a plant in another process: newest readings at once, through crashes of that process."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from colony.nav.maps.world_map import world_of
from colony.runtime.library.camera import array
from colony.runtime.protocol.images import Image
from colony.runtime.servers.drivers import BaseState
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.scene import scene_of
from colony.sim.config import limits_of
from colony.sim.plant.assembly import PlantOptions
from colony.sim.plant.control import PlantControl
from colony.sim.plant.protocol import Attached, BaseReading, Refusal, pack
from colony.sim.plant.servers import MAX_READING_AGE_NS, RemoteBase, RemoteCamera, RemoteProximity
from tests.buildings import HALLWAY
from tests.sim.plant.plants import START, PlantProcess, controlled, wait_for
from tests.sim.robots import FRONT_CAMERA, IDEAL, RING
from tests.waiting import PATIENCE_S

LIMITS = limits_of(IDEAL)


class Robot:
    """All drivers of one robot, of which the time began when they were made."""

    def __init__(self, path: Path, name: str = "rome") -> None:
        self.origin_ns = time.monotonic_ns()
        self.base = RemoteBase(path, name, limits=LIMITS, origin_ns=self.origin_ns)
        self.proximity = RemoteProximity(path, name, count=24, origin_ns=self.origin_ns)
        self.camera = RemoteCamera(path, name, "ahead", origin_ns=self.origin_ns)

    def ready(self) -> bool:
        return None not in (self.base.state(), self.proximity.sonar(), self.camera.grab())

    def mute(self) -> bool:
        readings = (self.base.state(), self.proximity.sonar(), self.proximity.infrared(), self.camera.grab())
        return readings == (None, None, None, None)

    def close(self) -> None:
        for driver in (self.base, self.proximity, self.camera):
            driver.close()


@pytest.fixture
def robot(plant: PlantProcess) -> Iterator[Robot]:
    made = Robot(plant.path)
    wait_for(made.ready)
    yield made
    made.close()


def test_readings_are_in_the_robot_s_time(robot: Robot) -> None:
    state, sonar, image = robot.base.state(), robot.proximity.sonar(), robot.camera.grab()
    assert state is not None
    assert sonar is not None
    assert image is not None
    now = time.monotonic_ns() - robot.origin_ns
    for t_ns in (state.t_ns, sonar.t_ns, image.t_ns):
        assert now - MAX_READING_AGE_NS - PATIENCE_S * 1e9 < t_ns <= now
    assert robot.base.problem is None


def test_robots_of_one_plant_see_each_other(robot: Robot, control: PlantControl) -> None:
    def ahead(range_mm: float) -> bool:
        sonar = robot.proximity.sonar()
        return sonar.value[12] == pytest.approx(range_mm)

    wait_for(lambda: ahead(9000.0 - 400.0 - RING.ring_mm))
    control.place("remus", START[0] + 1000.0, START[1], 0.0)
    wait_for(lambda: ahead(1000.0 - 400.0 - RING.ring_mm))
    infrared = wait_for(robot.proximity.infrared)
    assert infrared.value[12]
    assert not infrared.value[0]


def test_images_are_those_of_the_camera(robot: Robot, control: PlantControl) -> None:
    truths = [control.truth(name) for name in ("rome", "remus")]
    poses = np.array([(t.x, t.y, t.heading) for t in truths])
    camera = Camera(scene_of(HALLWAY), FRONT_CAMERA, robot_radius_mm=IDEAL.radius_mm)

    def image() -> Image | None:
        found = robot.camera.grab()
        return found if found is not None and found.t_ns + robot.origin_ns > truths[0].t_ns else None

    taken = wait_for(image)
    assert (array(taken) == camera.image(poses, 0, taken.t_ns + robot.origin_ns)).all()


def test_an_image_of_a_large_camera_fits_into_a_packet(tmp_path: Path) -> None:
    wide = replace(FRONT_CAMERA, width=640, height=480)
    given = PlantOptions(
        path=tmp_path / "plant",
        world=world_of(HALLWAY),
        robots={"rome": START},
        cameras={"wide": wide},
        config=IDEAL,
    )
    with controlled(given), closing(RemoteCamera(given.path, "rome", "wide", origin_ns=0)) as camera:
        image = wait_for(camera.grab)
    assert (image.width, image.height, len(image.pixels)) == (640, 480, 640 * 480)


def test_driving_and_stopping(robot: Robot, control: PlantControl) -> None:
    before = control.truth("rome")

    def drive() -> bool:
        robot.base.drive(200.0, 0.0)
        state = robot.base.state()
        return state is not None and state.speed == 200.0

    wait_for(drive)
    robot.base.stop()
    wait_for(lambda: control.truth("rome").velocity == 0.0)
    assert not control.truth("rome").driven
    assert control.truth("rome").x > before.x + 10.0


def test_a_base_whose_driver_is_closed_stands(plant: PlantProcess, control: PlantControl) -> None:
    robot = Robot(plant.path, "remus")

    def drive() -> bool:
        robot.base.drive(0.0, 30.0)
        return control.truth("remus").turn > 0.0

    wait_for(drive)
    robot.close()
    robot.close()
    wait_for(lambda: control.truth("remus").turn == 0.0)
    robot.base.drive(0.0, 30.0)  # of no effect any more, and no error
    robot.base.stop()
    assert not control.truth("remus").driven


def test_a_plant_that_is_killed_and_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "plant"
    robot = Robot(path)
    assert robot.mute()
    robot.base.stop()
    robot.base.drive(100.0, 0.0)
    assert (robot.base.problem, robot.base.is_opening) == (None, True)
    with PlantProcess(path, {"rome": START}) as plant:
        wait_for(robot.ready)
        plant.kill()
        wait_for(robot.mute)
        assert robot.base.problem is not None
        robot.base.drive(100.0, 0.0)
        plant.start_again()
        wait_for(robot.ready)
        with PlantControl(path, timeout_s=PATIENCE_S) as control:
            assert control.truth("rome").distance == 0.0  # commands of before are gone
        assert plant.end() == 0
    robot.close()


def test_a_driver_of_a_plant_that_never_answers_can_be_closed(tmp_path: Path) -> None:
    path = tmp_path / "plant"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(os.fspath(path))
        listener.listen()
        base = RemoteBase(path, "rome", limits=LIMITS, origin_ns=0)
        connection, _ = listener.accept()
        assert base.state() is None
        assert (base.problem, base.is_opening) == (None, True)
        base.close()
        connection.close()


def test_what_a_plant_says_may_be_nonsense(tmp_path: Path) -> None:
    path = tmp_path / "plant"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(os.fspath(path))
        listener.listen()
        base = RemoteBase(path, "rome", limits=LIMITS, origin_ns=0)
        for said in (b"\xff" * 100, pack(Refusal(message="no")), b""):
            connection, _ = listener.accept()
            connection.send(said)
            connection.close()
        connection, _ = listener.accept()  # it comes again and again
        state = BaseState(
            t_ns=time.monotonic_ns() + 3600 * 1_000_000_000,
            x=1.0,
            y=2.0,
            heading=3.0,
            front_bumper=True,
            rear_bumper=False,
            speed=4.0,
            turn_rate=5.0,
            wheel_speed=6.0,
        )
        for message in (Attached(began_ns=1), BaseReading(value=state, t_ns=state.t_ns)):
            connection.send(pack(message))
        assert wait_for(base.state) == state
        base.close()
        connection.close()


def test_readings_age(tmp_path: Path) -> None:
    with PlantProcess(tmp_path / "plant", {"rome": START}) as plant:
        now = [0]
        base = RemoteBase(plant.path, "rome", limits=LIMITS, origin_ns=0, clock=lambda: now[0])
        first = wait_for(lambda: (now.__setitem__(0, time.monotonic_ns()), base.state())[1])
        now[0] = time.monotonic_ns() + MAX_READING_AGE_NS + 3600 * 1_000_000_000
        assert base.state() is None
        now[0] = first.t_ns
        assert base.state() is not None
        base.close()
