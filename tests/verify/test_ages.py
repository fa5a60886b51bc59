"""A reading is as old as its frame says: too old it is missing, from the future it is a fault."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.dsl.load import load_text
from colony.ir.frame import Frame, FrameEvent
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import EXECUTORS, disagreement
from tests.drawn.strategies import Run, runs

MS = 1_000_000
PROGRAM = load_text("""
robot r {
  sensor scan[3] : mm   from Lidar.scan   within 200 ms
  sensor deadman : bool default false from Pad.deadman within 100 ms
  sensor bumper  : bool from Base.bumper
  actuator drive { velocity : mm/s range -600 .. 600 } to Base.drive idle drive(velocity = 0)
}
module cruise  { when deadman and min(scan) > 500 mm do drive(velocity = min(scan) / 2 s) }
module retreat { when bumper do drive(velocity = -100 mm/s) }
network { drive = retreat suppresses cruise }
""")
READINGS = {"scan": [1000.0, 900.0, 1100.0], "deadman": True, "bumper": False}


def winner(**ages_ms: float) -> str | None:
    """Who drives with readings that are so old."""
    taken = {name: round((1000 - age) * MS) for name, age in ages_ms.items()}
    return Interpreter(PROGRAM).step(Frame(1000 * MS, READINGS, taken)).commands["drive"].by


def test_a_reading_without_an_age_is_of_now() -> None:
    assert winner() == "cruise"


@pytest.mark.parametrize(("name", "within_ms"), [("scan", 200), ("deadman", 100)])
def test_a_reading_that_is_too_old_is_missing(name: str, within_ms: int) -> None:
    assert winner(**{name: within_ms}) == "cruise"
    assert winner(**{name: within_ms + 1e-6}) is None


def test_a_sensor_without_a_limit_may_be_of_any_age() -> None:
    assert winner(bumper=1e6) == "cruise"


def test_a_reading_from_the_future_is_a_fault() -> None:
    frame = Frame(0, READINGS, {"scan": 1, "bumper": 1})
    outcome = Interpreter(PROGRAM).step(frame)
    assert outcome.commands["drive"].by is None
    assert outcome.records == (FrameEvent("sensor fault", "scan"), FrameEvent("sensor fault", "bumper"))


@given(st.data(), runs(python=False))
def test_all_executors_agree_on_ages(data: st.DataObject, run: Run) -> None:
    program, trace = run
    aged = tuple(frame._replace(taken_ns=data.draw(ages(frame))) for frame in trace)
    assert disagreement(program, aged, EXECUTORS) is None


@given(st.lists(st.dictionaries(st.sampled_from(list(READINGS)), st.integers(-1, 3)), max_size=5))
def test_all_executors_agree_on_limits(shots: list[dict[str, int]]) -> None:
    trace = tuple(
        Frame(k * 50 * MS, READINGS, {n: k * 50 * MS - age * 100 * MS for n, age in ages.items()})
        for k, ages in enumerate(shots)
    )
    assert disagreement(PROGRAM, trace, EXECUTORS) is None


def ages(frame: Frame) -> st.SearchStrategy[dict[str, int]]:
    names = list(frame.readings) or ["nothing"]
    return st.dictionaries(st.sampled_from(names), st.integers(frame.t_ns - 10**9, frame.t_ns + 1))
