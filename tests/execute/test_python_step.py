"""A module in Python: what it is given, when it is called, and what its answer becomes."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from colony.execute.python_step import PythonStep, StepInput

FIELDS: tuple[tuple[str, object], ...] = (("on", False), ("v", None), ("g", (0.0, 67.0)))
GOOD = {"on": True, "v": 2, "g": 67}
S = 1_000_000_000


class Scripted:
    """Answers with what it is given, in turn, and keeps what it was given."""

    def __init__(self, *answers: object) -> None:
        self.answers, self.given = list(answers), list[StepInput]()

    def step(self, frame: StepInput) -> object:
        self.given.append(frame)
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer


def stepping(*answers: object, rate: int | None = None) -> tuple[PythonStep, Scripted]:
    scripted = Scripted(*answers)
    return PythonStep("m", scripted, FIELDS, rate), scripted


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s.__setitem__("x", 1),
        lambda s: s.__delitem__("x"),
        lambda s: setattr(s, "t", 1.0),
        lambda s: delattr(s, "t"),
        lambda s: s.__ior__({"y": 1}),
        lambda s: s.clear(),
        lambda s: s.pop("x"),
        lambda s: s.popitem(),
        lambda s: s.setdefault("y", 1),
        lambda s: s.update(y=1),
    ],
)
def test_a_snapshot_stays_as_it_is(change: Callable[[StepInput], object]) -> None:
    snapshot = StepInput(1.5, {"x": 1.0})
    with pytest.raises(TypeError, match=r"^a snapshot cannot be changed$"):
        change(snapshot)
    assert (dict(snapshot), snapshot.t) == ({"x": 1.0}, 1.5)


def test_where_something_is_missing_it_is_not_called() -> None:
    one, scripted = stepping()
    found = one.step(0, None, (("sensor fault", "x"),))
    assert repr(found) == repr((False, True, (False, 0.0, 0.0), (("sensor fault", "x"),)))
    assert scripted.given == []


def test_what_it_is_given() -> None:
    one, scripted = stepping(None, None)
    one.step(0, {}, ())
    one.step(1_500_000_000, {"x": 2.0}, ())
    assert [(given.t, dict(given)) for given in scripted.given] == [(0.0, {}), (1.5, {"x": 2.0})]


def test_answers() -> None:
    nothing = (False, 0.0, 0.0)
    wrong = (
        *({}, {"on": True}, {**GOOD, "more": 1}, [("on", True)], "on", 3, RuntimeError("mood")),
        *({**GOOD, "on": 1}, {**GOOD, "on": None}, {**GOOD, "v": True}, {**GOOD, "v": "2"}, {**GOOD, "g": 1}),
        *({**GOOD, "g": math.nan}, {**GOOD, "g": True}, {**GOOD, "v": None}),
    )
    for answer in wrong:
        one, _ = stepping(answer)
        records = (("a", "b"), ("python error", "m"))
        assert repr(one.step(0, {}, (("a", "b"),))) == repr((False, True, nothing, records))
    one, _ = stepping(None)
    assert repr(one.step(0, {}, ())) == repr((False, False, nothing, ()))
    for value, number in ((2, 2.0), (-0.0, -0.0), (math.nan, math.nan), (10**400, math.inf)):
        one, _ = stepping({**GOOD, "v": value})
        assert repr(one.step(0, {}, ())) == repr((True, False, (True, number, 67.0), ()))


def test_an_answer_takes_effect_a_rate_later_and_stands() -> None:
    one, scripted = stepping(GOOD, None, {**GOOD, "v": 3}, None, rate=2 * S)
    assert (one.due, one.pending, one.standing) == (0, None, False)
    calls = []
    for t in (5, 5 + 2 * S - 1, 5 + 2 * S, 5 + 4 * S, 5 + 6 * S - 1, 5 + 6 * S):
        active, blind, fields, _ = one.step(t, {}, ())
        calls.append((len(scripted.given), active, blind, fields[1]))
    first, second = (1, False, True, 0.0), (2, True, False, 2.0)
    third, fourth = (3, False, False, 0.0), (4, True, False, 3.0)
    assert calls == [first, first, second, third, third, fourth]


def test_with_a_rate_of_nothing_each_answer_takes_effect_at_once() -> None:
    one, scripted = stepping(GOOD, None, {**GOOD, "v": 3}, rate=0)
    found = [one.step(t, {}, ())[:3] for t in (5, 5, 6)]
    second, third = (False, False, (False, 0.0, 0.0)), (True, False, (True, 3.0, 67.0))
    assert found == [(True, False, (True, 2.0, 67.0)), second, third]
    assert len(scripted.given) == 3
    assert (one.due, one.pending) == (6, None)


def test_a_wrong_answer_stands_as_silence() -> None:
    one, _ = stepping(GOOD, {}, GOOD, rate=S)
    found = [one.step(t * S, {}, ()) for t in range(3)]
    assert [(active, blind) for active, blind, _, _ in found] == [(False, True), (True, False), (False, True)]
    assert found[1][3] == (("python error", "m"),)
