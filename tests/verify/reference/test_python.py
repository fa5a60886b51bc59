"""Modules written in Python: what they are given, when they are called, and what becomes of their answers."""

from __future__ import annotations

import math
from typing import Any

import pytest

from colony.ir.frame import Decision, Outcome, Record
from colony.text.diagnostics import Failure
from colony.verify.reference.interpreter import Interpreter
from tests.verify.scripted_modules import Scripted
from tests.verify.stepping import Shot, every, program, run

TEXT = """
let double = 2 * x
state count_up = 5
next count_up = count_up + 1
module m from python "tests.verify.scripted_modules:Scripted" {
  param width = 3.6 m
  param wait = 2 s
  reads x, four, double, count_up
  commands base
  RATE
}
module lesser { when true do base(speed = 0.1 m/s, turn = 0) }
network { base = m suppresses lesser }
"""

GOOD = {"speed": 500, "turn": 1.5}
FOUR = (1.0, 2.0, 3.0, 4.0)


@pytest.fixture(autouse=True)
def _fresh() -> None:
    Scripted.answers, Scripted.seen, Scripted.built = [], [], []


def answered(answers: list[Any], *shots: Shot, rate: str = "") -> list[Outcome]:
    """Outcomes of `base` with a module that gives these answers."""
    Scripted.answers = answers
    return run(TEXT.replace("RATE", rate), *shots)


def there(count: int, period_ms: float = 50) -> list[Shot]:
    return [(i * period_ms, {"x": float(i), "four": FOUR}) for i in range(count)]


def by(outcomes: list[Outcome]) -> list[str | None]:
    return [o.decisions[1].by for o in outcomes]


def test_built_once_with_params_in_base_units() -> None:
    answered([None, None], *there(2))
    assert Scripted.built == [{"width": 3600.0, "wait": 2.0}]


def test_it_is_given_what_it_reads_in_base_units() -> None:
    answered([None, None], *there(2))
    assert Scripted.seen == [
        (0.0, {"x": 0.0, "four": FOUR, "double": 0.0, "count_up": 5.0}),
        (0.05, {"x": 1.0, "four": FOUR, "double": 2.0, "count_up": 6.0}),
    ]


def test_what_it_is_given_is_read_only() -> None:
    def change(frame: Any) -> object:
        frame["x"] = 1.0
        return GOOD

    [outcome] = answered([change], *there(1))
    assert outcome.records == (Record("python error", "m"),)


def test_commands_and_none() -> None:
    first, second = answered([GOOD, None], *there(2))
    assert first.decisions[1] == Decision("base", "m", (0.5, 1.5))
    assert second.decisions[1].by == "lesser"
    assert first.records == second.records == ()


def boom(frame: object) -> object:
    raise RuntimeError("boom")


@pytest.mark.parametrize(
    "answer",
    [
        boom,
        {},
        {"speed": 1.0},
        {"speed": 1.0, "turn": 1.0, "more": 1.0},
        {"speed": True, "turn": 1.0},
        {"speed": "fast", "turn": 1.0},
        {"speed": None, "turn": 1.0},
        (1.0, 2.0),
        False,
        7,
    ],
)
def test_what_is_wrong_makes_it_silent_and_is_recorded(answer: Any) -> None:
    [outcome] = answered([answer], *there(1))
    assert outcome.decisions[1].by == "lesser"
    assert outcome.records == (Record("python error", "m"),)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_command_that_is_not_finite_wins_all_the_same(bad: float) -> None:
    [outcome] = answered([{"speed": bad, "turn": 0.0}], *there(1))
    assert outcome.decisions[1] == Decision("base", "m", (0.0, 0.0), "not finite")
    assert outcome.records == (Record("not finite", "m"),)


def test_not_called_where_something_is_missing() -> None:
    shots = [(0, {"x": 1.0, "four": FOUR}), (50, {"x": 1.0}), (100, {"x": 1.0, "four": FOUR})]
    assert by(answered([GOOD, GOOD], *shots)) == ["m", "lesser", "m"]
    assert [t for t, _ in Scripted.seen] == [0.0, 0.1]


def test_a_rate_answers_exactly_that_much_later() -> None:
    outcomes = answered([GOOD, None, GOOD], *there(8), rate="rate 100 ms")
    assert [t for t, _ in Scripted.seen] == [0.0, 0.1, 0.2, 0.3][: len(Scripted.seen)]
    #              0 ms      50 ms     100  150  200       250       300  350
    assert by(outcomes)[:7] == ["lesser", "lesser", "m", "m", "lesser", "lesser", "m"]


def test_a_rate_between_frames() -> None:
    outcomes = answered([GOOD, None, GOOD], *there(7), rate="rate 120 ms")
    assert [t for t, _ in Scripted.seen] == [0.0, 0.15, 0.3]
    assert by(outcomes) == ["lesser"] * 3 + ["m", "m", "m", "lesser"]  # None, asked at 150, from 270 on


def test_with_a_rate_a_missing_frame_is_silent_and_the_answer_stands_afterwards() -> None:
    shots = there(5)
    shots[3] = (150, {"x": 1.0})
    outcomes = answered([GOOD, GOOD, GOOD], *shots, rate="rate 100 ms")
    assert by(outcomes) == ["lesser", "lesser", "m", "lesser", "m"]


def test_an_error_with_a_rate_is_recorded_when_it_happens_and_silent_when_it_is_due() -> None:
    outcomes = answered([GOOD, boom, GOOD], *there(6), rate="rate 100 ms")
    assert by(outcomes) == ["lesser", "lesser", "m", "m", "lesser", "lesser"]
    assert [i for i, o in enumerate(outcomes) if o.records] == [2]


@pytest.mark.parametrize(
    "path",
    [
        "no_such:X",
        "tests.verify.scripted_modules:Missing",
        "tests.verify.scripted_modules:Unbuildable",
        "tests.verify.scripted_modules:Leaving",
    ],
)
def test_a_class_that_cannot_be_built_is_a_located_error(path: str) -> None:
    text = f'module m from python "{path}" {{ commands out }}\nnetwork {{ out = m }}'
    with pytest.raises(Failure, match=r"<text>:\d+:\d+: error\[P001\]"):
        Interpreter(program(text))


def test_helpers() -> None:
    assert every(50, a="1.") == [(0, {"a": True}), (50, {"a": None})]
