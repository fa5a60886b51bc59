"""Counterexamples are made as small as they can be, and still break the contract."""

from __future__ import annotations

import pytest

from colony.ir.program import Program
from colony.ir.types import Value
from colony.verify.contracts.concrete_runs import Replay
from colony.verify.contracts.refute import minimize
from colony.verify.contracts.results import Trace
from colony.verify.snapshot import Snapshot
from tests.verify.contracts.behaviors import program

MS = 1_000_000


def least(text: str, *snapshots: Snapshot, patience: int | None = None) -> tuple[Program, Trace]:
    made = program(text)
    replay = Replay(made, "c")
    assert replay.breaks(snapshots)
    return made, minimize(replay, snapshots, patience)


def test_frames_that_are_not_needed_are_left_out() -> None:
    frames = [Snapshot(t_ns=i * 70 * MS + 3, readings={"bump": i == 1, "x": float(i)}) for i in range(6)]
    _, trace = least("contract c: not fresh(bump) or not latch(bump, stop) or bump", *frames)
    assert [(s.t_ns, s.readings) for s in trace.snapshots] == [
        (0, {"bump": True}),
        (50 * MS, {"bump": False}),
    ]
    assert trace.outcomes[-1].breaches == ("c",)


def test_what_comes_after_the_breach_is_left_out() -> None:
    frames = [Snapshot(t_ns=i, readings={"bump": True}) for i in range(4)]
    _, trace = least("contract c: not bump", *frames)
    assert len(trace.snapshots) == 1


RAYS = (1.5, 2.25, 700.123, 9000.0, 17.0, 3.0)


@pytest.mark.parametrize(
    ("contract", "readings", "simpler"),
    [
        ("not fresh(far) or far < 4.7 m", {"far": 4781.234567}, {"far": 10_000.0}),
        ("not (fresh(far) and far in 4.7 m .. 4.85 m)", {"far": 4781.234567}, {"far": 4800.0}),
        ("not (fresh(rays) and rays[2] in 650 mm .. 750 mm)", {"rays": RAYS}, {"rays": (700.0,) * 6}),
    ],
)
def test_readings_become_round_in_the_declared_unit_and_alike(
    contract: str, readings: dict[str, Value], simpler: dict[str, Value]
) -> None:
    _, trace = least(f"contract c: {contract}", Snapshot(t_ns=0, readings=readings))
    assert trace.snapshots[0].readings == simpler


def test_elements_that_make_a_difference_are_kept() -> None:
    contract = "contract c: not (fresh(rays) and rays[2] in 650 mm .. 750 mm and rays[3] > 8 m)"
    _, trace = least(contract, Snapshot(t_ns=0, readings={"rays": RAYS}))
    [value] = trace.snapshots[0].readings.values()
    assert (len(set(value)), value[2], value[3]) == (2, 700.0, 9000.0)


def test_times_that_matter_are_kept_but_rounded() -> None:
    frames = [Snapshot(t_ns=t, readings={"bump": t == 0}) for t in (0, 1_999_123_456)]
    _, trace = least("contract c: back is active implies now < 1.9 s", *frames)
    assert [s.t_ns for s in trace.snapshots] == [0, 1_900 * MS]


def test_a_sensor_that_must_be_missing_is_told() -> None:
    _, trace = least("contract c: fresh(far) or fresh(slope)", Snapshot(t_ns=0, readings={"x": 1.0}))
    assert trace.needed_missing == ("far", "slope")


def test_without_patience_the_trace_stays_as_it_is() -> None:
    frame = Snapshot(t_ns=0, readings={"far": 4781.234567, "x": 3.0})
    _, trace = least("contract c: far < 4.7 m", frame, patience=0)
    assert trace.snapshots == (frame,)
    assert trace.outcomes[-1].breaches == ("c",)


def test_a_simpler_value_that_breaks_the_contract_sooner() -> None:
    text = """let b = previous(x, 9)
let a = previous(b, 9)
contract c: not (fresh(x) and (b == 3 and x == 0 or a == 3 and b == 2 and x == 1))
"""
    frames = [Snapshot(t_ns=50 * i * MS, readings={"x": x}) for i, x in enumerate((3.0, 2.0, 1.0))]
    _, trace = least(text, *frames)
    assert [s.readings["x"] for s in trace.snapshots] == [3.0, 0.0]
