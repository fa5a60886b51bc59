"""Properties of a behavior, tested the way its author would: with hypothesis, over traces of its sensors.

    from colony.verify.testing.strategies import frames, traces

A trace is a tuple of frames: a time in nanoseconds, and readings by sensor in declared units. What fails is
shrunk to few frames with plain readings before it is shown.
"""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import find, given, settings
from hypothesis import strategies as st

from colony.dsl.load import load_file, load_text
from colony.ir.frame import Decision, Frame
from colony.verify.testing.agreement import reference
from colony.verify.testing.strategies import frames, traces
from tests.paths import ROOT

WANDER = load_file(ROOT / "behaviors" / "wander.colony")

Trace = tuple[Frame, ...]


def velocity(decision: Decision) -> float:
    return decision.values[0]


@given(traces(WANDER))
def test_never_forward_on_the_front_bumper(trace: Trace) -> None:
    for frame, outcome in zip(trace, reference(WANDER, trace), strict=True):
        if frame.readings["front_bumper"] is True:
            assert velocity(outcome.decisions[0]) <= 0


@given(traces(WANDER))
def test_stands_still_without_sonar(trace: Trace) -> None:
    for frame, outcome in zip(trace, reference(WANDER, trace), strict=True):
        if frame.readings["sonar"] is None:
            assert outcome.decisions[0].by is None
            assert velocity(outcome.decisions[0]) == 0


@given(traces(WANDER), st.integers(-(10**12), 10**12))
def test_only_how_much_time_passes_matters(trace: Trace, later_ns: int) -> None:
    moved = tuple(frame._replace(t_ns=frame.t_ns + later_ns) for frame in trace)
    assert repr(reference(WANDER, moved)) == repr(reference(WANDER, trace))


@given(frames(WANDER))
def test_a_first_frame_never_drives_backward_without_a_bump(frame: Frame) -> None:
    (outcome,) = reference(WANDER, (frame,))
    if frame.readings["front_bumper"] is False:
        assert velocity(outcome.decisions[0]) >= 0


# --- what a property is worth ------------------------------------------------------------------------


SEEDS = pytest.mark.parametrize(
    "seed", [0, *(pytest.param(n, marks=pytest.mark.thorough) for n in range(1, 5))]
)

CARELESS = """
robot r {
  sensor near : m range 0 .. 10 from PServer.near
  sensor bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s } to RServer.drive idle drive(velocity = 0)
}
module cruise { when true do drive(velocity = 300 mm/s) }
module back_off { when recently(bumper, 1 s) and near < 2 m do drive(velocity = -100 mm/s) }
network { drive = back_off suppresses cruise }
"""


FICKLE = """
import robot
let lhs = min(sonar[15 deg .. 90 deg])
let rhs = min(sonar[-90 deg .. -15 deg])
module slide {
  when min(sonar[-30 deg .. 30 deg]) < 700 mm
  do drive(velocity = 100 mm/s, turn = if lhs > rhs then 40 deg/s else -40 deg/s)
}
module back { when recently(front_bumper, 1 s) do drive(velocity = -100 mm/s, turn = 0) }
network { drive = back suppresses slide }
contract keeps_side:
  previous(drive by slide, false) and drive by slide implies previous(drive.turn, 0) * drive.turn > 0
"""


@SEEDS
def test_a_module_that_changes_sides_is_found_in_60_draws_and_shrunk_in_few(seed: int) -> None:
    fickle, runs = load_text(FICKLE, robot="rome"), list[Trace]()

    def changes_side(trace: Trace) -> bool:
        runs.append(trace)
        return any(outcome.breaches for outcome in reference(fickle, trace))

    found = find(
        traces(fickle),
        changes_side,
        settings=settings(max_examples=60, database=None),
        random=Random(seed),
    )
    assert len(found) == 2
    assert [name for name, reading in found[0].readings.items() if reading is not None] == ["sonar"]
    assert len(runs) < 200


@SEEDS
def test_a_property_that_does_not_hold_is_refuted_by_little(seed: int) -> None:
    careless = load_text(CARELESS)

    def forward_after_bump(trace: Trace) -> bool:
        """Within half a second."""
        bumped_ns: int | None = None
        for frame, outcome in zip(trace, reference(careless, trace), strict=True):
            if frame.readings["bumper"] is True:
                bumped_ns = frame.t_ns
            recently = bumped_ns is not None and frame.t_ns - bumped_ns < 500_000_000
            if recently and velocity(outcome.decisions[0]) > 0:
                return True
        return False

    found = find(
        traces(careless),
        forward_after_bump,
        settings=settings(max_examples=500, database=None),
        random=Random(seed),
    )
    assert len(found) == 1
    assert found[0].readings["bumper"] is True
