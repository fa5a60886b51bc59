"""Traces shrink to the least that shows it."""

from __future__ import annotations

import math
from random import Random

from colony.ir.frame import Frame, Reading
from colony.verify.testing.frames import Choices, draw_trace
from colony.verify.testing.shrinking import shrink_trace
from tests.programs import MS, program

OF = program("module m { when a do out(v = 1) }\nnetwork { out = m }")


def numbers(trace: tuple[Frame, ...], name: str) -> list[Reading]:
    return [frame.readings.get(name) for frame in trace]


def test_only_the_frames_that_matter_are_left() -> None:
    trace = tuple(Frame(i * 7 * MS + 3, {"a": i in (4, 9), "x": float(i)}) for i in range(12))

    def twice(frames: tuple[Frame, ...]) -> int | None:
        at = [i for i, f in enumerate(frames) if f.readings["a"] is True]
        return at[1] if len(at) > 1 else None

    left = shrink_trace(OF, trace, twice)
    assert numbers(left, "a") == [True, True]
    assert numbers(left, "x") == [0.0, 0.0]
    assert [f.t_ns for f in left] == [0, 50 * MS]


def test_times_that_matter_stay() -> None:
    trace = (Frame(5, {}), Frame(61 * MS, {}), Frame(300 * MS, {}))

    def apart(frames: tuple[Frame, ...]) -> int | None:
        return 1 if len(frames) > 1 and frames[1].t_ns - frames[0].t_ns > 60 * MS else None

    left = shrink_trace(OF, trace, apart)
    assert [f.t_ns for f in left] == [0, 100 * MS]


def test_arrays_become_plain_where_they_can() -> None:
    trace = (Frame(0, {"four": [3.25, 8.5, 9.125, 1.0], "bits": (True, False, True, True)}),)

    def third(frames: tuple[Frame, ...]) -> int | None:
        four = frames[0].readings["four"]
        return 0 if isinstance(four, list | tuple) and len(four) == 4 and float(four[2]) > 9 else None

    (left,) = shrink_trace(OF, trace, third)
    assert left.readings["four"] == [0.0, 0.0, 9.125, 0.0]
    assert left.readings["bits"] == (False,) * 4


def test_readings_that_cannot_be_become_plain_or_missing() -> None:
    trace = (Frame(0, {"x": math.nan, "y": "high", "a": 3.5}),)  # type: ignore[dict-item]
    (left,) = shrink_trace(OF, trace, lambda frames: 0 if frames[0].readings.get("x") != 0.0 else None)
    assert left.readings["x"] is None
    assert left.readings["y"] == 0.0
    assert left.readings["a"] is False


def test_what_is_left_always_shows_it() -> None:
    for seed in range(30):
        trace = draw_trace(Choices(Random(seed)), OF, 10)
        wanted = Random(seed).randrange(len(trace))
        readings = repr(trace[wanted].readings["four"])

        def shows(frames: tuple[Frame, ...], readings: str = readings) -> int | None:
            return next((i for i, f in enumerate(frames) if repr(f.readings["four"]) == readings), None)

        left = shrink_trace(OF, trace, shows)
        assert shows(left) == len(left) - 1 == 0
        assert left[0].readings["x"] == 0.0


def test_the_frames_computed_are_bounded() -> None:
    computed = 0

    def shows(frames: tuple[Frame, ...]) -> int | None:
        nonlocal computed
        computed += len(frames)
        return len(frames) - 1

    trace = draw_trace(Choices(Random(1)), OF, 12)
    shrink_trace(OF, trace, shows, frame_budget=2 * len(trace))
    assert len(trace) < computed <= 2 * len(trace)
