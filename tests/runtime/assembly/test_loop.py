"""One frame of the loop: what is read, decided and carried out, in which order and in which units."""

from __future__ import annotations

import pytest

from colony.dsl.load import load_text
from colony.ir.frame import Frame, Outcome
from colony.runs.behavior import behavior_from
from colony.runtime.assembly.loop import Loop
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.library import data, robot
from colony.runtime.servers.drivers import Drivers, Reading
from colony.runtime.transport.virtual import VirtualClock
from colony.sim.world.world import World
from tests.experiment.conformance_stage import PROGRAM, WALLS
from tests.experiment.loops import loop_of
from tests.kit.base import RollingBase
from tests.robot_servers import ROME_SERVERS
from tests.runtime.kit.test_devices import LIFT, Device
from tests.sim.robots import IDEAL


class Stage:
    """The tester's loop, and the frames it has had. Mutable."""

    def __init__(self, *scripts: Script, x_mm: float = 0.0, program: str = PROGRAM) -> None:
        self.frames: list[tuple[Frame, Outcome]] = []
        self.world = World(walls=WALLS, poses=[(x_mm, 0.0, 270.0)], config=IDEAL)
        self.loop = loop_of(
            behavior_from(load_text(program)),
            self.world,
            {str(i): script for i, script in enumerate(scripts)},
            watch=lambda frame, outcome: self.frames.append((frame, outcome)),
        )

    def run(self, frames: int) -> None:
        for _ in range(frames):
            self.loop.frame()

    def reading(self, sensor: str) -> list[object]:
        return [frame.readings.get(sensor) for frame, _ in self.frames]


def _set_once(name: str, value: object, after_s: float) -> Script:
    yield from sleep(after_s)
    yield from do("DServer", data.set(name, value))


def test_variables_are_read_in_the_next_frame_and_grow_old() -> None:
    stage = Stage(_set_once("Wanted", 200, 0.1))
    stage.run(14)
    # Set in frame 2; `within 400 ms` of then are the frames up to the tenth.
    assert stage.reading("wanted") == [None] * 3 + [200.0] * 8 + [None] * 3
    assert [outcome.decisions[0].by for _, outcome in stage.frames] == [None] * 3 + ["go"] * 8 + [None] * 3
    assert stage.world.speed(0).velocity_mm_s < 200.0  # it is stopping again


def test_readings_are_in_base_units_and_lists_are_no_numbers() -> None:
    stage = Stage(_set_once("Wanted", [1.0, 2.0], 0.0), x_mm=1500.0)
    stage.run(3)
    assert stage.reading("x") == [1500.0] * 3
    assert stage.reading("wanted")[1] == (1.0, 2.0)
    assert stage.frames[1][1].decisions[0].by is None
    assert ("sensor fault", "wanted") in [tuple(record) for record in stage.frames[1][1].records]


def test_what_the_network_sets_scripts_read_in_the_same_frame() -> None:
    read: list[object] = []

    def script() -> Script:
        while True:
            read.append((yield from do("DServer", data.get("Count"))))
            yield from sleep(0.05)

    stage = Stage(script())
    stage.run(4)
    assert read == [0.0, 1.0, 2.0, 3.0]


def test_nothing_is_driven_into_a_pressed_bumper() -> None:
    def push() -> Script:
        while True:
            yield from do("DServer", data.set("Wanted", 300))
            yield from sleep(0.1)

    speeds: list[object] = []

    def look() -> Script:
        yield from sleep(2.5)
        speeds.append((yield from do("RServer", robot.bumper())))
        speeds.append((yield from do("RServer", robot.speed_setting())))

    ramp = "\nlimit drive.velocity <= max(last.drive.velocity, 0 mm/s) + 100 mm/s\n"
    stage = Stage(push(), look(), x_mm=8450.0, program=PROGRAM + ramp)
    stage.run(60)
    assert stage.world.bumper(0).front
    assert 300.0 in stage.reading("last.drive.velocity")
    assert stage.reading("last.drive.velocity")[-1] == 0.0
    assert speeds == [robot.Bumpers(front=True, rear=False), 0.0]


def test_closing_stops_the_robot_and_the_scripts() -> None:
    ends: list[str] = []

    def push() -> Script:
        try:
            yield from do("DServer", data.set("Wanted", 300))
            yield from sleep(100.0)
        finally:
            ends.append("ended")

    stage = Stage(push())
    stage.run(6)
    stage.loop.close()
    assert ends == ["ended"]
    stage.world.advance(2.0)
    assert stage.world.speed(0).velocity_mm_s == pytest.approx(0.0)


def test_what_was_sent_is_read_in_the_next_frame() -> None:
    ramp = "\nlimit drive.velocity <= max(last.drive.velocity, 0 mm/s) + 100 mm/s\n"
    stage = Stage(_set_once("Wanted", 400, 0.0), program=PROGRAM + ramp)
    stage.run(4)
    assert stage.reading("last.drive.velocity") == [None, 0.0, 100.0, 200.0]
    sent = [outcome.decisions[0].values for _, outcome in stage.frames]
    assert [values[0] for values in sent if values is not None] == [0.0, 100.0, 200.0, 300.0]


def test_what_a_module_did_is_known_in_the_next_frame() -> None:
    slow = "\nlimit drive.velocity <= 50 mm/s when not (last.drive by go and last.go is active)\n"
    stage = Stage(_set_once("Wanted", 400, 0.0), program=PROGRAM + slow)
    stage.run(4)
    assert stage.reading("last.drive by go") == [None] * 4, "the executor knows it"
    sent = [outcome.decisions[0].values for _, outcome in stage.frames]
    assert [values[0] for values in sent if values is not None] == [0.0, 50.0, 400.0, 400.0]


def test_a_module_does_not_get_through_where_a_device_refuses_its_command() -> None:
    device = Device({"height": Reading(0.0, 0), "moving": Reading(False, 0)})
    program = load_text(
        "robot r { frame 50 ms  actuator lift { height : mm range 0 .. 400, fast : bool }"
        " to Lift.move idle lift(height = 0, fast = false) }\n"
        "module up { when true do lift(height = if last.lift by up then 200 mm else 100 mm, fast = true) }\n"
        "network { lift = up }"
    )
    clock, frames = VirtualClock(), list[object]()
    behavior = behavior_from(program)
    loop = Loop(
        behavior.robot,
        behavior.executor(),
        Drivers(servers=(LIFT, *ROME_SERVERS), base=RollingBase(), devices={"Lift": device}),
        {},
        clock=clock,
        advance=lambda: None,
        watch=lambda frame, outcome: frames.append(outcome.decisions[0].values),
    )
    for failing in (False, False, True, False, False):
        device.failing_commands = failing
        loop.frame()
    assert frames == [(100.0, True), (200.0, True), (200.0, True), (100.0, True), (200.0, True)]
