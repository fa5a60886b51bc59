"""Guided traces meet what is rare, and a program's own tests are ways to begin with."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from itertools import pairwise
from random import Random

import pytest

from colony.dsl.load import load_text
from colony.ir.expression import StateValue
from colony.ir.frame import Frame
from colony.ir.types import DIMENSIONLESS
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.frames import Choices, draw_trace, frames_of, snapshots_of
from colony.verify.testing.guided import MAX_PREFIX_FRAMES, Guide
from tests.programs import MS, program

Learn = Callable[[Sequence[Frame], Sequence[Hashable]], object]

LOCK = """
state place = 0
next place = if place == 0 and x == 31 then 1 else
             if place == 1 and y == 17 then 2 else
             if place == 2 and x == 12 then 3 else
             if place == 3 and y == 64 then 4 else place
module opened { when place == 4 do out(v = 1) }
network { out = opened }
"""
"""It opens after four readings in a row, each of them one of many."""


def steps_to_open(draw: Callable[[int], tuple[Frame, ...]], learn: Learn, most: int) -> int | None:
    """How many traces it takes."""
    of = program(LOCK)
    for number in range(most):
        trace, interpreter, patterns = draw(number), Interpreter(of), []
        place = StateValue(type=DIMENSIONLESS, name="place")
        for frame in trace:
            by = interpreter.step(frame).decisions[0].by
            patterns.append((by, interpreter.value_of(place)))
        if any(by == "opened" for by, _ in patterns):
            return number
        learn(trace, patterns)
    return None


@pytest.mark.long
def test_a_lock_opens_and_only_to_who_remembers_how_far_it_was() -> None:
    of = program(LOCK)
    guide = Guide(of, 6)
    guided = steps_to_open(lambda i: guide.draw(Choices(Random(i))), guide.learn, 1000)
    alone = steps_to_open(lambda i: draw_trace(Choices(Random(i)), of, 6), lambda *_: None, 1000)
    print(f"guided after {guided} traces, alone after {alone}")
    assert guided is not None
    assert alone is None


def test_traces_are_traces() -> None:
    of = program(LOCK)
    guide = Guide(of, 6)
    for seed in range(200):
        trace = guide.draw(Choices(Random(seed)))
        assert 1 <= len(trace) <= MAX_PREFIX_FRAMES + 4
        assert all(a.t_ns < b.t_ns for a, b in pairwise(trace))
        guide.learn(trace, [len(f.readings) * 100 + i for i, f in enumerate(trace)])


def test_the_shortest_way_is_kept() -> None:
    of = program(LOCK)
    guide = Guide(of, 6)
    long = tuple(Frame(i * MS, {"x": 1.0}) for i in range(5))
    short = (Frame(0, {"x": 2.0}), Frame(3 * MS, {"x": 2.0}))
    guide.learn(long, ["a", "a", "a", "a", "b"])
    guide.learn(short, ["a", "b"])
    begun = [guide.draw(Choices(Random(seed)))[:2] for seed in range(60)]
    assert short in begun
    assert long[:2] not in begun


def test_a_test_block_as_frames() -> None:
    of = program(
        'test "t" { at 0 s given x = 1, four = 2, angle = 1 rad, bits = [true, false, true, false]\n'
        "           at 1 s given four[2] = 3, x = missing, feel = mood.alert\n"
        "           from 2 s to 3 s every 500 ms given bits[0] = false, four = missing\n"
        "           at 4 s given y = 0 }"
    )
    first, second, third, *_, last = frames_of(of, of.tests[0])
    assert first.readings == {
        "x": 1.0,
        "four": (2.0,) * 4,
        "angle": first.readings["angle"],
        "bits": (True, False, True, False),
    }
    assert Interpreter(of).step(first).records == ()
    assert second.readings["four"] == (2.0, 2.0, 3.0, 2.0)
    assert second.readings["x"] is None
    assert second.readings["feel"] == 67.0
    assert third.readings["bits"] == (False, False, True, False)
    assert [f.t_ns // MS for f in frames_of(of, of.tests[0])] == [0, 1000, 2000, 2500, 3000, 4000]
    assert last.readings["four"] is None


def test_a_reading_that_is_too_old_is_missing_in_the_frames_of_a_test_block() -> None:
    of = load_text(
        "robot r { sensor x : m from PServer.x within 100 ms }\n"
        'test "t" { from 0 s to 200 ms every 50 ms given x = 2 m taken 50 ms ago }'
    )
    assert [f.readings["x"] for f in frames_of(of, of.tests[0])] == [2.0, 2.0, None, None, None]
    assert [s.readings.get("x") for s in snapshots_of(of, of.tests[0])] == [2000.0, 2000.0, None, None, None]
