"""The encoding says, frame by frame, what the reference interpreter does."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
import z3

from colony.dsl.load import load_file, load_text
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.verify.symbolic import functions
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.system import ExtendedReal, Reason
from colony.verify.symbolic.unrolling import reasons_of
from colony.verify.testing.frames import Choices, draw_trace, frames_of
from tests.drawn.strategies import run_of_seed
from tests.paths import BEHAVIORS
from tests.sampling import sampled
from tests.verify.symbolic.trust import Tally, Trust, held_against

ROBOT = """
enum mood { calm = 0, alert = 67, lost = -2.5 }
robot drawn {
  sensor a : number                                from DServer.a
  sensor b : number range -4 .. 3                  from DServer.b
  sensor c : number range -1 .. 700 default 2.5    from DServer.c
  sensor n : number range 0 .. 40                  from DServer.n
  sensor p : bool                                  from DServer.p
  sensor q : bool default true                     from DServer.q
  sensor s[5] : number range -9 .. 100             from DServer.s
  sensor u[3] : number                             from DServer.u
  sensor f[4] : bool                               from DServer.f
  sensor m : mood                                  from DServer.m
  sensor angle : deg                               from DServer.angle
  actuator drive { v : mm/s range -600 .. 500, w : deg/s } to RServer.drive
           idle drive(v = 1 mm/s, w = 2 deg/s)
  actuator light { level : number, on : bool, mood : mood } to DServer.light idle hold
}
"""


def tally_of(program: Program, seeds: range, frames: int = 8) -> Tally:
    """All of the traces of some seeds, in one tally."""
    total, trust = Tally(), Trust(program)
    for seed in seeds:
        one = trust.run(draw_trace(Choices(Random(seed)), program, frames))
        total.exact += one.exact
        total.within += one.within
        total.open += one.open
        total.differences += [f"seed {seed}: {d}" for d in one.differences]
    return total


EXACT = [
    "if p then a else b",
    "if p then a < b else q",
    "min(a, b, c)",
    "max(a, b, c)",
    "min(s)",
    "max(u)",
    "clamp(a, -2, c)",
    "abs(a)",
    "sign(a)",
    "sign(b) * 3",
    "-a",
    "floor(b)",
    "ceil(b)",
    "round(b)",
    "floor(a)",
    "round(a)",
    "ceil(a)",
    "mod(n, 7)",
    "mod(floor(b), 3)",
    "a < b",
    "a <= 2",
    "a >= b",
    "a > c",
    "a == b",
    "a != b",
    "u == u",
    "a in b .. c",
    "p and q",
    "p or not q",
    "p implies q",
    "p == q",
    "p != q",
    "m == mood.alert",
    "m != mood.lost",
    "if m == mood.calm then 3 else if m == mood.lost then 0.1 else 0.2",
    "s[n]",
    "s[a]",
    "f[a]",
    "f[b]",
    "s[2 * round(n)]",
    "window(s, n, 1)",
    "window(u, a, 1)",
    "s[1..3]",
    "index_of_min(s)",
    "index_of_max(u)",
    "index_of_min(window(s, n, 2))",
    "index_of_max(window(u, a, 1))",
    "index_of_min(s[1..4])",
    "index_of_max(window(s, 0 / 0, 1))",
    "s[index_of_max(s)]",
    "count(f)",
    "count(s < 10)",
    "any(f)",
    "all(f)",
    "any(s[k] > k for k in 0 .. 4)",
    "all(f[k] for k in 0 .. 3 if p)",
    "count(f[k] for k in 0 .. 3 if s[k] > 0)",
    "min(s[k] for k in 0 .. 4 if s[k] > k)",
    "max(u[k] for k in 0 .. 2 if u[k] < 1)",
    "sum(k for k in 0 .. 3 if f[k])",
    "sum(k for k in 1 .. 0)",
    "mean(2 for k in 0 .. 3 if f[k])",
    "cos(15 deg * index_of_min(s))",
    "angle_difference(15 deg * round(n), 180 deg)",
    "fresh(a)",
    "fresh(c)",
    "value_or(a, 1)",
    "value_or(a, b)",
    "value_or(previous(a, 3), c)",
    "value_or(s, c)",
    "previous(a, 1)",
    "previous(a, b)",
    "previous(p, false)",
    "previous(s, 3)",
    "previous(m == mood.lost, true)",
    "changed(a)",
    "changed(p)",
    "changed(m)",
    "rising(p)",
    "falling(p)",
    "rising(f)",
    "recently(p, 150 ms)",
    "recently(p, 0 ms)",
    "recently(f, 50 ms)",
    "latch(p, q)",
    "latch(f, p)",
    "captured(a, p)",
    "captured(a, b)",
    "captured(m, p)",
    "captured(s, a)",
    "captured(a, true)",
    "captured(a, sqrt(-1))",
    "every(100 ms)",
    "every(50 ms) and p",
    "any(recently(f[k], 50 ms) for k in 0 .. 3)",
    "count(rising(s[k] > k) for k in 0 .. 4)",
    "now >= 0 s",
    "now < 0.1 s",
    "now == 0.15 s",
    "now > 0.1 s or 0.05 s >= now",
    "elapsed(p) < 100 ms",
    "elapsed(p) in 50 ms .. 150 ms",
    "elapsed(p) >= (if q then 0.1 s else 0.05 s)",
]

INEXACT = [
    "a + b",
    "a - b",
    "b - c",
    "u + a",
    "a * 0.1",
    "a / 3",
    "a * b",
    "b * c",
    "a * a",
    "b * (if p then 2.5 else -0.1)",
    "c * floor(b)",
    "a / b",
    "a / c",
    "1 / b",
    "1 / round(b)",
    "1 / ceil(b)",
    "a / (b * (-1 / (1 / 0)))",
    "b / (if p then 0 else 2)",
    "atan2(round(b), -1)",
    "b / (c + 2)",
    "(c + 1) / (1 / 0)",
    "a * (1 / 0)",
    "a * 0",
    "a / 0",
    "a / (-1 / (1 / 0))",
    "mod(a, 7)",
    "mod(a, -2.5)",
    "mod(b, 0.5)",
    "mod(a, b)",
    "mod(a, 1 / 0)",
    "mod(a, 0)",
    "mod(a, if p then 2 else -3)",
    "sqrt(a)",
    "sqrt(c + 1)",
    "sin(angle)",
    "cos(angle)",
    "atan2(a, b)",
    "atan2(b, c)",
    "angle_difference(angle, 10 deg)",
    "angle_difference(angle, 15 deg * round(n))",
    "sum(s)",
    "mean(u)",
    "sum(s[k] for k in 0 .. 4 if f[k - 1])",
    "mean(s[k] for k in 0 .. 4 if s[k] > 0)",
    "now",
    "elapsed(p)",
    "elapsed(f)",
    "round(a + 0.5)",
    "floor(b * 1.1)",
    "s[a / 3]",
    "recently(a + b < 1, 100 ms)",
    "min(s[k] / cos(k * 15 deg) for k in 0 .. 4)",
]


EXACT_AFTER_ALL = (
    "mod(a, 1 / 0)",
    "a * (1 / 0)",
    "a * 0",
    "a / 0",
    "mod(a, 0)",
    "a / (-1 / (1 / 0))",
    "(c + 1) / (1 / 0)",
)
"""Nothing in these can round."""


@pytest.mark.parametrize("expression", EXACT + INEXACT)
def test_expressions(expression: str) -> None:
    program = load_text(ROBOT + f"let v = {expression}\n")
    tally = tally_of(program, range(2))
    assert not tally.differences
    assert tally.exact + tally.within > tally.open


BEAMS = """
robot scanner {
  sensor s[30] : mm range 0 .. 9000 from DServer.s
  sensor u[30] : number             from DServer.u
  sensor r[36] : mm bearing -180 deg range 0 .. 9000 from DServer.r
  actuator drive { v : mm/s } to RServer.drive idle drive(v = 0)
}
"""


@pytest.mark.parametrize(
    "expression",
    [
        "min(s)",
        "max(u)",
        "min(x for x in s if x > 1 m)",
        "max(x for x in u if x < s[3] / 1 mm)",
        "min(abs(x) for x in u)",
        "index_of_min(s)",
        "index_of_max(u)",
        "index_of_min(r[170 deg .. 110 deg])",
        "s[index_of_max(s)]",
        "r[index_of_min(r[170 deg .. 110 deg])]",
        "s[index_of_min(s) + 1]",
    ],
)
def test_extremes_of_many_are_exact_without_a_chain_of_choices(
    expression: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(functions, "MANY", 24)
    program = load_text(BEAMS + f"let v = {expression}\n")
    tally = tally_of(program, range(3))
    assert not tally.differences
    assert tally.exact > tally.open
    system = encode(program)
    assert any(a.operation.name.endswith(("LEAST", "GREATEST")) for a in system.auxiliaries)


@pytest.mark.parametrize("expression", EXACT)
def test_what_copies_and_compares_is_exact(expression: str) -> None:
    assert not _reasons(expression)


@pytest.mark.parametrize("expression", [e for e in INEXACT if e not in EXACT_AFTER_ALL])
def test_what_rounds_or_is_abstracted_says_so(expression: str) -> None:
    assert _reasons(expression)


def _reasons(expression: str) -> tuple[Reason, ...]:
    system = encode(load_text(ROBOT + f"let v = {expression}\n"))
    value = system.derived["v"][1]
    terms: list[z3.ExprRef] = []
    for x in value if isinstance(value, tuple) else (value,):
        terms += (x.value, x.nan, x.infinite) if isinstance(x, ExtendedReal) else (x,)
    return reasons_of(system, *terms)


@pytest.mark.parametrize("path", sampled(BEHAVIORS, every=4, thorough=True), ids=lambda p: p.stem)
def test_examples_of_behaviors(path: Path) -> None:
    program = load_file(path)
    trust = Trust(program)
    traces = [(e.name, frames_of(program, e)[:4]) for e in program.tests]
    for name, trace in traces[:: max(1, len(traces) // 3)]:
        tally = trust.run(trace)
        assert not tally.differences, name
        assert tally.exact + tally.within > tally.open


@pytest.mark.parametrize("start", sampled([0, 12, 24], every=3, thorough=True))
def test_drawn_programs(start: int) -> None:
    for seed in range(start, start + 12):
        tally = held_against(*run_of_seed(seed, max_frames=4))
        assert not tally.differences, f"seed {seed}"


def test_remainders_of_numbers_beyond_the_whole_floats() -> None:
    """A multiple of the divisor need not be a float where the number is."""
    program = load_text(
        ROBOT + "state far : number = 1e303\n"
        "module m { when true do drive(v = mod(if p then far else 0 / 0, 7) * 1 mm/s, w = 0 deg/s) }\n"
        "network { drive = m }\n"
    )
    frame = Frame(0, {"p": True})
    assert held_against(program, [frame]).differences == []


def test_drawn_networks() -> None:
    for seed in range(60):
        tally = held_against(*run_of_seed(seed, network=True, max_frames=5))
        assert not tally.differences, f"seed {seed}"
        assert not tally.open
        assert not tally.within
