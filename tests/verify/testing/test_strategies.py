"""What the strategies draw is valid, varied, and the same for the same seed."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise
from random import Random

import pytest
from hypothesis import Phase, find, given, settings
from hypothesis import strategies as st

from colony.dsl.load import check_text, load_file, load_text
from colony.ir.frame import Frame
from colony.ir.program import Chain, Program, Wiring
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.frames import Choices, draw_trace, durations_of, gaps_of
from colony.verify.testing.strategies import frames, traces
from tests.drawn.program_text import draw_text
from tests.drawn.strategies import network_runs, networks, programs, run_of_seed, texts
from tests.paths import ROOT
from tests.programs import MS, program

ASSUMING = """
robot r {
  sensor a : number from S.a
  actuator out { v : number } to S.out idle out(v = 0)
}
assume slow: a - previous(a, 0) <= 3
assume near: a < 10
"""


@given(texts())
def test_texts_are_valid_programs(text: str) -> None:
    checked = check_text(text)
    assert checked.program is not None, checked.diagnostics


@given(st.data())
def test_public_strategies_fit_together(data: st.DataObject) -> None:
    of = data.draw(networks(max_modules=3, max_wires=2))
    interpreter = Interpreter(of)
    for frame in data.draw(traces(of, max_frames=4)):
        assert len(interpreter.step(frame).decisions) == len(of.robot.actuators)
    assert data.draw(frames(of, t_ns=7)).t_ns == 7


@given(st.data())
def test_traces_can_be_as_they_are_assumed(data: st.DataObject) -> None:
    of = load_text(ASSUMING)
    for outcome in map(Interpreter(of).step, data.draw(traces(of, as_assumed=True))):
        assert outcome.breaches == ()


@settings(max_examples=10)
@given(programs(python=False))
def test_python_modules_can_be_left_out(of: Program) -> None:
    assert "PythonModule" not in {type(module).__name__ for module in of.modules}


def test_a_failing_test_prints_frames_that_can_be_pasted() -> None:
    of = program("module m { when a do out(v = 1) }\nnetwork { out = m }")

    @settings(max_examples=1, database=None, deadline=None, phases=[Phase.generate])
    @given(traces(of, max_frames=1))
    def failing(trace: tuple[Frame, ...]) -> None:
        raise AssertionError(len(trace))

    with pytest.raises(AssertionError) as raised:
        failing()
    printed = "".join(raised.value.__notes__)
    start, end = printed.index("trace=") + len("trace="), printed.rindex(",\n)")
    [frame] = eval(printed[start:end], {"Frame": Frame, "nan": math.nan, "inf": math.inf})
    assert isinstance(frame, Frame)


def test_a_seed_is_a_run() -> None:
    assert repr(run_of_seed(5)) == repr(run_of_seed(5))
    assert repr(run_of_seed(5, network=True)) != repr(run_of_seed(6, network=True))


def depth(wiring: Wiring) -> int:
    return 1 + max(map(depth, wiring.operands)) if isinstance(wiring, Chain) else 0


def test_networks_are_varied() -> None:
    found: Counter[str] = Counter()
    for seed in range(100):
        of, trace = run_of_seed(seed, network=True)
        chains = [w.wiring for w in of.wires if isinstance(w.wiring, Chain)]
        uses = Counter(repr(w.wiring).count("name='w0'") for w in of.wires)
        found["fan-out"] += sum(count * times for count, times in uses.items()) > 1
        found["nested"] += any(depth(c) > 1 for c in chains)
        found["time constants"] += any(any(c.windows_ns) for c in chains)
        found["pure inhibitors"] += any(m.actuator is None for m in of.modules)
        found["several actuators"] += len(of.robot.actuators) > 1
        found["several frames"] += len(trace) > 2
    assert min(found.values()) >= 20, found
    assert len(found) == 6


def test_programs_use_the_whole_language() -> None:
    words = (
        "recently sustained elapsed latch captured every previous changed rising falling value_or fresh "
        "window machine tan asin acos "
        "state param let limit contract python index_of_min index_of_max angle_difference atan2 sin mod "
        "clamp sqrt "
        "suppresses[ inhibits[ idle default within range count any all mean sum min max for implies now()"
    ).split()
    found: Counter[str] = Counter()
    for seed in range(300):
        text = draw_text(Choices(Random(seed)), True)
        found.update(word for word in words if word in text)
    assert [word for word in words if found[word] < 3] == []


@pytest.mark.long
def test_outcomes_are_varied() -> None:
    found: Counter[str] = Counter()
    for seed in range(150):
        of, trace = run_of_seed(seed)
        interpreter = Interpreter(of)
        for frame in trace:
            outcome = interpreter.step(frame)
            found.update({record.kind for record in outcome.records})
            found["breach"] += bool(outcome.breaches)
            found["commanded"] += any(d.by for d in outcome.decisions)
            found["idle hold"] += any(d.values is None for d in outcome.decisions)
    kinds = ("sensor fault", "sensor clamped", "python error", "not finite", "limited", "command clamped")
    assert all(found[kind] >= 10 for kind in (*kinds, "breach", "commanded", "idle hold")), found


TIMED = program(
    "module m { when recently(a, 120 ms) do out(v = 1) }\nnetwork { out = m suppresses[170 ms] m }"
)


@given(traces(TIMED, max_frames=6))
def test_times_rise(trace: tuple[Frame, ...]) -> None:
    times = [frame.t_ns for frame in trace]
    assert times == sorted(set(times))
    assert 1 <= len(times) <= 6


def test_traces_hold_what_goes_wrong() -> None:
    drawn = [draw_trace(Choices(Random(seed)), TIMED, 8) for seed in range(200)]
    gaps = Counter(b.t_ns - a.t_ns for trace in drawn for a, b in pairwise(trace))
    for duration in (120_000_000, 170_000_000):
        assert all(gaps[duration + off] >= 10 for off in (-1, 0, 1)), gaps
    assert gaps[1] >= 10
    readings = [frame.readings for trace in drawn for frame in trace]
    assert any(reading["a"] is None for reading in readings)
    assert any(isinstance(x, float) and math.isnan(x) for r in readings for x in r.values())
    lengths = {len(r["four"]) for r in readings if isinstance(r["four"], list | tuple)}
    assert {3, 4, 5} <= lengths
    assert any(isinstance(r["x"], int) for r in readings)


def test_what_is_drawn_shrinks() -> None:

    def wins_late(run: tuple[Program, tuple[Frame, ...]]) -> bool:
        interpreter = Interpreter(run[0])
        return any(decision.by == "m1" for frame in run[1] for decision in interpreter.step(frame).decisions)

    of, trace = find(network_runs(), wins_late, settings=settings(max_examples=2000), random=Random(1))
    assert len(of.modules) == 2
    assert len(trace) == 1
    assert len(of.wires) <= 2


@pytest.mark.parametrize(
    ("won", "expected"),
    [
        ("m1", [(0, {"a": True})]),
        ("m2", [(0, {"x": 3.0})]),
        ("m3", [(0, {"b": True, "x": 0.0}), (50 * MS, {"b": True, "x": 0.0})]),
    ],
)
def test_a_failing_trace_shrinks_to_the_frames_and_readings_that_matter(
    won: str, expected: list[tuple[int, dict[str, object]]]
) -> None:
    of = program(
        "module m1 { when a do out(v = 1) }\nmodule m2 { when x > 2.5 and x < 100 do out(v = 2) }\n"
        "module m3 { when b and previous(b, false) and x < 1 do out(v = 3) }\n"
        "network { out = m1 suppresses (m2 suppresses m3) }"
    )

    def wins(trace: tuple[Frame, ...]) -> bool:
        interpreter = Interpreter(of)
        return any(d.by == won for frame in trace for d in interpreter.step(frame).decisions)

    found = find(traces(of), wins, settings=settings(max_examples=300, database=None), random=Random(1))
    assert [(f.t_ns, {name: x for name, x in f.readings.items() if x is not None}) for f in found] == expected


@pytest.mark.long
@pytest.mark.parametrize("name", ["wander", "herbert"])
def test_traces_of_a_behavior_reach_its_modules(name: str) -> None:
    of = load_file(ROOT / "behaviors" / f"{name}.colony")
    won: Counter[str | None] = Counter()
    for seed in range(150):
        interpreter = Interpreter(of)
        for frame in draw_trace(Choices(Random(seed)), of, 8):
            won.update(d.by for d in interpreter.step(frame).decisions)
    commanding = {m.name for m in of.modules if m.actuator} - {"home", "visit"}
    assert commanding <= won.keys()


def test_some_traces_begin_as_a_test_does() -> None:
    of = program(
        "module m { when x > 3 do out(v = 1) }\nnetwork { out = m }\n"
        'test "t" { at 1 s given x = 123456, four = [1, 2, 3, 4], bits = true\n'
        "           from 2 s to 3 s every 500 ms given four[1] = 7, bits = missing }"
    )
    traces = [draw_trace(Choices(Random(seed)), of, 8) for seed in range(100)]
    begun = [t for t in traces if t[0].readings.get("x") == 123456]
    assert 10 < len(begun) < 60
    longest = max(begun, key=lambda t: sum(f.readings.get("x") == 123456 for f in t))
    assert [f.t_ns for f in longest[:3]] == [1_000_000_000, 2_000_000_000, 2_500_000_000]
    assert longest[0].readings["bits"] == (True,) * 4
    assert longest[1].readings == {"x": 123456, "four": (1, 7, 3, 4), "bits": None}


def test_readings_are_at_beside_and_between_what_is_compared() -> None:
    of = program("module m { when angle > 20 deg or angle < -30 deg do out(v = 1) }\nnetwork { out = m }")
    found = {
        f.readings["angle"]
        for seed in range(200)
        for f in draw_trace(Choices(Random(seed)), of, 4)
        if isinstance(f.readings["angle"], float)
    }
    least = -30.0
    assert {20.0, least, math.nextafter(20.0, math.inf), math.nextafter(20.0, -math.inf)} <= found
    assert any(least < x < 20 for x in found)
    assert any(x > 20.1 for x in found)
    assert any(x < least - 0.1 for x in found)


def test_time_constants_within_parentheses_are_waited_for() -> None:
    of = program(
        "module m1 { when a do out(v = 1) }\nmodule m2 { when x > 3 do out(v = 2) }\n"
        "module m3 { when true do out(v = 3) }\n"
        "network { out = m1 suppresses ((m2 suppresses[700 ms] m3) inhibits[300 ms] m1) }"
    )
    assert durations_of(of) == [700 * MS, 300 * MS]
    for gap in (700 * MS, 700 * MS - 1, 300 * MS, 300 * MS + 1):
        assert gap in gaps_of(of)
