"""RServer over a base that drives sideways, and over one that does not."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from colony.ir.servers import OMNIDIRECTIONAL_RSERVER
from colony.runtime.library import robot
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.deployment import ActuatorFieldSpec
from colony.runtime.protocol.messages import Bounds
from colony.runtime.servers.drivers import BaseState
from colony.runtime.servers.piloting import (
    Context,
    allowed_range,
    drive,
    full_range,
    initial_settings,
    mismatch,
)
from tests.kit.base import LIMITS, RollingBase, Stage, bid, deployed, silent

SIDEWAYS_LIMITS = replace(LIMITS, sideways=400.0, sideways_acceleration=600.0)
SIDEWAYS = {
    "fields": (
        ActuatorFieldSpec(name="velocity", kind="number", factor=1.0, low=-300.0, high=500.0),
        ActuatorFieldSpec(name="turn", kind="number", factor=1.0, low=-60.0, high=60.0),
        ActuatorFieldSpec(name="sideways", kind="number", factor=1.0, low=-200.0, high=250.0),
    ),
    "field_indices": (0, 1, 2),
    "idle": (0.0, 0.0, 0.0),
}


class SlidingBase(RollingBase):
    """A base that takes on its sideways speed at once, too; `slid` are the commands."""

    limits = SIDEWAYS_LIMITS

    def __init__(self) -> None:
        super().__init__()
        self.sideways = 0.0
        self.slid: list[tuple[float, float, float]] = []

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> None:
        super().drive(velocity, turn)
        self.sideways = sideways
        self.slid.append((velocity, turn, sideways))

    def stop(self) -> None:
        super().stop()
        self.sideways = 0.0

    def state(self) -> BaseState | None:
        found = super().state()
        return None if found is None else replace(found, sideways_speed=self.sideways)


def stage_with(**changes: object) -> tuple[Stage, SlidingBase]:
    """A stage with a sliding base, on which a program runs that binds `sideways`."""
    base = SlidingBase()
    return Stage(base, run="r1", deployment=deployed(**(SIDEWAYS | changes))), base  # type: ignore[arg-type]


def test_it_has_exactly_the_documented_fields() -> None:
    stage = Stage(SlidingBase())
    stage.tick()
    assert set(stage.frames[-1].fields) == {f.name for f in OMNIDIRECTIONAL_RSERVER.fields}


def test_a_program_drives_it_sideways() -> None:
    stage, base = stage_with(reported=(2,))
    stage.frame(bid("cruise", 100.0, -10.0, 200.0), *silent("cruise"))
    assert base.slid == [(100.0, -10.0, 200.0)]
    stage.tick()
    fields = stage.frames[-1].fields
    names = ("sideways_setting", "sideways_speed", "last.drive.sideways")
    assert [fields[name].value for name in names] == [200.0] * 3  # type: ignore[union-attr]


def test_a_program_without_sideways_drives_it_as_any_base() -> None:
    base = SlidingBase()
    stage = Stage(base, run="r1", deployment=deployed())
    stage.frame(bid("cruise", 300.0, -10.0), *silent("cruise"))
    assert base.slid == [(300.0, -10.0, 0.0)]
    stage.open("ann/1", priority=9)
    stage.do("ann/1", robot.drive(0.0, 0.0, sideways=-400.0))
    stage.frame(*silent())
    assert base.slid[-1] == (0.0, 0.0, -400.0)


def test_a_pressed_bumper_blocks_the_way_ahead_alone() -> None:
    stage, base = stage_with(reported=(0, 2))
    base.front = True
    stage.frame(bid("cruise", 100.0, 10.0, 200.0), *silent("cruise"))
    assert base.slid[-1] == (0.0, 10.0, 200.0)
    note = "frame 0: 100 mm/s was not sent, as the front bumper is pressed"
    assert note in stage.verdicts[-1].notes
    stage.tick()
    fields = stage.frames[-1].fields
    assert [fields[f"last.drive.{n}"].value for n in ("velocity", "sideways")] == [0.0, 200.0]  # type: ignore[union-attr]


def test_a_connection_drives_it_sideways_and_stops_it_gradually() -> None:
    base = SlidingBase()
    stage = Stage(base)
    stage.tick()
    stage.open("ann/1")
    stage.do("ann/1", robot.drive(0.0, 0.0, sideways=300.0))
    stage.frame()
    assert base.slid[-1] == (0.0, 0.0, 300.0)
    stage.do("ann/1", robot.stop())
    stage.frame(count=2)
    assert [sideways for _, _, sideways in base.slid[-2:]] == [280.0, 260.0]
    assert stage.problem("ann/1", robot.drive(0.0, 0.0, sideways=401.0)).message.endswith(
        "sideways is 401 mm/s; expected -400 to 400 mm/s"
    )


def test_a_connection_is_held_to_the_range_and_the_limits_of_the_program() -> None:
    stage, base = stage_with(limited=True)
    stage.tick()
    stage.open("ann/1", priority=9)
    assert stage.problem("ann/1", robot.drive(0.0, 0.0, sideways=300.0)).code == "arguments"
    stage.do("ann/1", robot.drive(0.0, 0.0, sideways=250.0, lease=1.0))
    stage.tick()
    bounds = Bounds(k=stage.k, actuator="drive", low=(-300.0, -60.0, -200.0), high=(500.0, 60.0, 50.0))
    for message in (bounds, *(msgspec.structs.replace(r, k=stage.k) for r in silent())):
        stage.handle(message)
    assert base.slid[-1] == (0.0, 0.0, 50.0)
    assert stage.verdicts[-1].values == (0.0, 0.0, 50.0)


def test_a_base_with_two_wheels_refuses_what_drives_sideways() -> None:
    sideways = robot.Drive(velocity=0.0, turn=0.0, sideways=5.0)
    with pytest.raises(RefusedError, match="sideways is 5 mm/s; the base does not drive sideways"):
        drive(sideways, Context(initial_settings(LIMITS), full_range(LIMITS)))
    sliding = deployed(**SIDEWAYS).actuators  # type: ignore[arg-type]
    assert mismatch(sliding, LIMITS) == "`drive`: it drives sideways, which this base cannot"
    assert mismatch(sliding, SIDEWAYS_LIMITS) is None
    assert allowed_range(sliding[0], SIDEWAYS_LIMITS).sideways == (-200.0, 250.0)
    without = deployed(field_indices=(0, 1, None)).actuators
    assert mismatch(without, LIMITS) is None
    assert allowed_range(without[0], LIMITS).sideways == (0.0, 0.0)
