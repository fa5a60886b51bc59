"""Frames of programs outside: what is none changes nothing, and numbers of numpy are numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.checked import CheckedExecutor, checked_frame, checked_trace
from colony.execute.compiled import Compiled
from colony.ir.frame import Frame

TEXT = """
robot toy {
  sensor   bumper  : bool from Base.bumper within 200 ms
  sensor   near[3] : m range 0 .. 10 from Lidar.near
  actuator drive { velocity : mm/s } to Base.drive idle drive(velocity = 0)
}
module cruise   { when near[2] > 0.5 m do drive(velocity = 400 mm/s) }
module back_off { when bumper          do drive(velocity = -100 mm/s) }
network { drive = back_off suppresses cruise }
"""
READINGS = {"bumper": False, "near": (5, 5, 5)}


@pytest.fixture(scope="module")
def compiled() -> Compiled:
    return compile_program(load_text(TEXT)).compiled


@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        (None, "found None; expected a colony.Frame"),
        ({}, "found {}; expected a colony.Frame"),
        (Frame(0, None), "readings: found None"),  # type: ignore[arg-type]
        (Frame(0, [5]), "readings: found"),  # type: ignore[arg-type]
        (Frame(0, READINGS, None), "taken_ns: found None"),  # type: ignore[arg-type]
        (Frame(0, READINGS, {"near": None}), "taken_ns of near: found None"),  # type: ignore[dict-item]
        (Frame(0, READINGS, {"near": 0.5}), "taken_ns of near: found 0.5"),  # type: ignore[dict-item]
        (Frame("0", READINGS), "t_ns: found '0'; expected whole nanoseconds"),  # type: ignore[arg-type]
        (Frame(None, READINGS), "t_ns: found None"),  # type: ignore[arg-type]
        (Frame(float("nan"), READINGS), "t_ns: found nan"),  # type: ignore[arg-type]
        (Frame(0.5, READINGS), "t_ns: found 0.5"),  # type: ignore[arg-type]
    ],
)
def test_what_is_no_frame_is_refused_and_changes_nothing(
    compiled: Compiled, frame: Any, expected: str
) -> None:
    robot = CheckedExecutor(compiled)
    with pytest.raises(TypeError, match=expected):
        robot.step(frame)
    with pytest.raises(TypeError, match=expected):
        checked_trace([frame], compiled.robot.sensors)
    assert robot.step(Frame(0, READINGS)).commands["drive"].by == "cruise"


@pytest.mark.parametrize("t_ns", [10, 9, -1, 2**62, -(2**62), 10**400])
def test_times_rise_and_fit_into_63_bits(compiled: Compiled, t_ns: int) -> None:
    robot = CheckedExecutor(compiled)
    robot.step(Frame(10, READINGS))
    with pytest.raises(ValueError, match="t_ns: found"):
        robot.step(Frame(t_ns, READINGS))
    with pytest.raises(ValueError, match="t_ns: found"):
        checked_trace([Frame(10, READINGS), Frame(t_ns, READINGS)], compiled.robot.sensors)
    robot.step(Frame(11, READINGS))
    robot.restart()
    robot.step(Frame(-5, READINGS))


@pytest.mark.parametrize(
    ("frame", "problem"),
    [
        (
            Frame(0, READINGS | {"nera": 1.0}),
            "readings: found 'nera', which is no sensor; did you mean `near`",
        ),
        (Frame(0, {"x": None}), "found 'x', which is no sensor; the robot has `bumper` and `near`"),
        (Frame(0, READINGS, {"bumpre": 0}), "did you mean `bumper`"),
        (Frame(0, {7: 1.0}), "found 7, which is no sensor"),  # type: ignore[dict-item]
    ],
)
def test_a_name_of_no_sensor_is_refused(compiled: Compiled, frame: Frame, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        CheckedExecutor(compiled).step(frame)
    with pytest.raises(ValueError, match=problem):
        checked_trace([frame], compiled.robot.sensors)


@pytest.mark.parametrize("t_ns", [2**62 - 1, -(2**62) + 1])
def test_the_first_and_last_times(compiled: Compiled, t_ns: int) -> None:
    frame = Frame(t_ns, READINGS, {"near": t_ns})
    assert checked_frame(frame, None, compiled.robot.sensors) == frame


def test_times_at_which_readings_were_taken_may_be_of_the_future(compiled: Compiled) -> None:
    outcome = CheckedExecutor(compiled).step(Frame(0, READINGS, {"near": 1}))
    assert [tuple(record) for record in outcome.records] == [("sensor fault", "near")]


def test_numbers_of_numpy_are_numbers(compiled: Compiled) -> None:
    readings = {"bumper": np.bool_(True), "near": np.float32(0.25)}
    given = Frame(np.int64(3), readings, {"near": np.int64(2)})  # type: ignore[arg-type, dict-item]
    frame = checked_frame(given, None, compiled.robot.sensors)
    assert repr(frame) == repr(Frame(3, {"bumper": True, "near": 0.25}, {"near": 2}))


@pytest.mark.parametrize("near", [np.ones(3, dtype=np.float32), [np.float32(1)] * 3, (1, np.float64(1), 1.0)])
def test_arrays_of_numpy_are_arrays(compiled: Compiled, near: Any) -> None:
    outcome = CheckedExecutor(compiled).step(Frame(0, {"near": near}))
    assert (outcome.commands["drive"].by, outcome.records) == ("cruise", ())
