"""Modules in Python, in every executor: what they are given, and what becomes of their answers."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, nan
from typing import Any

import pytest

from colony.dsl.load import load_text
from colony.execute.executor import ModuleExecutor, ProgramExecutor
from colony.ir.frame import Answer, Decision, Frame, FrameEvent, Outcome
from colony.text.diagnostics import DiagnosticError
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import ALL_EXECUTORS, EXECUTORS, disagreement
from tests.executors import outcomes
from tests.programs import MS, client, compilation, program
from tests.verify.scripted_modules import Scripted

TEXT = """
enum mood { calm = 0, alert = 67 }
robot r {
  sensor x : m from DServer.x
  sensor a[2] : bool from DServer.a
  actuator out { v : mm, on : bool, mood : mood } to DServer.Out idle hold
}
let twice = x * 2
state n = 5
next n = n + 1
module m from python "tests.verify.scripted_modules:Scripted" {
  param width = 3.6 m
  param wait = 2 s
  reads x, a, twice, n
  commands out
  RATE
}
module low { when true  do out(v = 0, on = false, mood = mood.calm) }
network { out = m suppresses low }
"""
GOOD = {"v": 3, "on": True, "mood": 67}
TOLD = Answer((3.0, True, 67.0))
SENT = Outcome((Decision("out", "m", (3.0, True, 67.0)),))
LOW = Decision("out", "low", (0.0, False, 0.0))


def shot(ms: float, **readings: Any) -> Frame:
    return Frame(round(ms * MS), {"x": 0.5, "a": [True, False]} | readings)


def there(count: int) -> list[Frame]:
    return [shot(50 * k, x=float(k)) for k in range(count)]


def answered(answers: list[Any], *shots: Frame, rate: str = "", text: str = TEXT) -> tuple[Outcome, ...]:
    """Return what all executors decide with a module that gives these answers; all give it the same."""
    Scripted.answers = answers
    of = load_text(text.replace("RATE", rate))

    def given(run: Any) -> tuple[object, str]:
        Scripted.seen.clear()
        Scripted.built.clear()
        return run(), repr((Scripted.seen, Scripted.built))

    expected, seen = given(lambda: outcomes(of, shots, {}))
    for name, make in EXECUTORS.items():
        found = given(lambda name=name, make=make: disagreement(of, shots, {name: make}, expected))
        assert found == (None, seen), name
    given(lambda: outcomes(of, shots, ALL_EXECUTORS))
    return given(lambda: outcomes(of, shots, {}))[0]  # type: ignore[return-value]


def by(found: tuple[Outcome, ...]) -> list[str | None]:
    return [outcome.decisions[0].by for outcome in found]


def boom(frame: Mapping[str, Any]) -> object:
    raise KeyError(frame["nothing"])


def test_it_is_built_once_and_given_what_it_reads_in_base_units() -> None:
    answered([None, None], shot(10_000), shot(10_250, x=2))
    assert Scripted.built == [{"width": 3600.0, "wait": 2.0}]
    assert repr(Scripted.seen) == repr(
        [
            (0.0, {"x": 500.0, "a": (True, False), "twice": 1000.0, "n": 5.0}),
            (0.25, {"x": 2000.0, "a": (True, False), "twice": 4000.0, "n": 6.0}),
        ]
    )


def test_what_it_is_given_is_read_only() -> None:
    def change(frame: Any) -> object:
        assert isinstance(frame, Mapping)
        frame["x"] = 1.0  # type: ignore[index]
        return GOOD

    [outcome] = answered([change], shot(0))
    assert outcome.records == (FrameEvent("python error", "m"),)
    Scripted.answers = [lambda frame: setattr(frame, "t", 3.0)]
    for make in EXECUTORS.values():
        assert make(compilation(TEXT.replace("RATE", ""))).step(shot(0)).records == outcome.records


def test_commands_and_none() -> None:
    assert answered([GOOD, None], *there(2)) == (SENT, Outcome((LOW,)))


@pytest.mark.parametrize(
    "answer",
    [
        *(boom, {}, {"v": 3, "on": True}, GOOD | {"more": 1}),
        *(GOOD | {"v": True}, GOOD | {"v": "3"}, GOOD | {"v": None}),
        *(GOOD | {"on": 1}, GOOD | {"mood": 5}, GOOD | {"mood": nan}),
        *((1.0, 2.0), False, 5, 7, [], "von"),
    ],
)
def test_what_is_wrong_makes_it_silent_and_is_recorded(answer: Any) -> None:
    [outcome] = answered([answer], shot(0))
    assert outcome == Outcome((LOW,), (FrameEvent("python error", "m"),))


@pytest.mark.parametrize("value", [nan, inf, 10**400], ids=["nan", "inf", "huge"])
def test_a_command_that_is_not_finite_wins_and_is_not_sent(value: float) -> None:
    [outcome] = answered([GOOD | {"v": value}], shot(0))
    assert outcome.decisions == (Decision("out", "m", None, "not finite"),)
    assert outcome.records == (FrameEvent("not finite", "m"),)


def test_it_is_not_called_where_something_is_missing() -> None:
    found = answered([GOOD, GOOD], shot(0), shot(50, a=None), shot(75, x=nan), shot(100))
    assert by(found) == ["m", "low", "low", "m"]
    assert [t for t, _ in Scripted.seen] == [0.0, 0.1]


# --- with a rate ---------------------------------------------------------------------------------


def test_a_rate_answers_exactly_that_much_later() -> None:
    found = answered([GOOD, None, GOOD, None], *there(8), rate="rate 100 ms")
    assert [t for t, _ in Scripted.seen] == [0.0, 0.1, 0.2, 0.3]
    assert by(found) == ["low", "low", "m", "m", "low", "low", "m", "m"]


def test_a_rate_between_frames() -> None:
    found = answered([GOOD, None, GOOD], *there(7), rate="rate 120 ms")
    assert [t for t, _ in Scripted.seen] == [0.0, 0.15, 0.3]
    assert by(found) == ["low"] * 3 + ["m", "m", "m", "low"]  # None, asked at 150, from 270 on


def test_no_answer_outlives_a_missing_frame() -> None:
    shots = there(8)
    shots[3] = shot(150, a=None)
    found = answered([GOOD] * 4, *shots, rate="rate 100 ms")
    assert by(found) == ["low", "low", "m", "low", "low", "low", "m", "m"]


def test_an_error_is_recorded_when_it_happens_and_silent_when_it_is_due() -> None:
    found = answered([GOOD, boom, GOOD], *there(6), rate="rate 100 ms")
    assert by(found) == ["low", "low", "m", "m", "low", "low"]
    assert [i for i, outcome in enumerate(found) if outcome.records] == [2]


def test_an_answer_takes_effect_when_the_next_is_asked() -> None:
    def answer(frame: Mapping[str, Any]) -> object:
        if frame["x"] == 4000.0:
            raise ValueError
        return None if frame["x"] == 3000.0 else GOOD | {"v": frame["x"]}

    shots = [
        shot(1000, x=None),
        shot(2000, x=1.0),  # called
        shot(2200, x=9.0),
        shot(2300, x=2.0),  # in effect, called
        shot(2400, x=None),  # silent, and the answers so far are forgotten
        shot(2500, x=9.0),
        shot(2700, x=3.0),  # called
        shot(3000, x=4.0),  # called
        shot(3300, x=5.0),
    ]
    found = answered([answer] * 5, *shots, rate="rate 300 ms")
    sent = [d.values[0] if d.by == "m" and d.values else None for d in (o.decisions[0] for o in found)]
    assert sent == [None, None, None, 1000.0, None, None, None, None, None]
    assert [t for t, _ in Scripted.seen] == [1.0, 1.3, 1.7, 2.0, 2.3]
    assert [bool(outcome.records) for outcome in found] == [False] * 7 + [True, False]


# --- failsafe modules ------------------------------------------------------------------------------

FAILSAFE = TEXT.replace("module m ", "failsafe module m ")
BLIND = Outcome((Decision("out", "m", None, "missing"),), (FrameEvent("missing", "m"),))


def test_a_failsafe_one_is_blind_where_something_that_it_reads_is_missing_and_is_not_called() -> None:
    shots = [shot(0), shot(50, x=None), shot(100, a=[True]), shot(150)]
    sent, blind, faulty, none = answered([GOOD, None], *shots, text=FAILSAFE)
    assert (sent, blind, none) == (SENT, BLIND, Outcome((LOW,)))
    assert faulty == BLIND._replace(records=(FrameEvent("sensor fault", "a"), FrameEvent("missing", "m")))
    assert [t for t, _ in Scripted.seen] == [0.0, 0.15]


@pytest.mark.parametrize("answer", [boom, {}, GOOD | {"more": 1}, GOOD | {"on": 1}, False, []])
def test_a_failsafe_one_is_blind_without_a_good_answer(answer: Any) -> None:
    [outcome] = answered([answer], shot(0), text=FAILSAFE)
    assert outcome == BLIND._replace(records=(FrameEvent("python error", "m"), FrameEvent("missing", "m")))


def test_a_failsafe_one_that_is_not_applicable_is_not_blind() -> None:
    assert answered([None], shot(0), text=FAILSAFE) == (Outcome((LOW,)),)


def test_a_failsafe_one_is_blind_until_its_first_answer_and_while_a_failed_one_stands() -> None:
    found = answered([GOOD, boom, None, GOOD], *there(8), rate="rate 100 ms", text=FAILSAFE)
    decided = [outcome.decisions[0] for outcome in found]
    blind, sent = BLIND.decisions[0], SENT.decisions[0]
    assert decided == [blind, blind, sent, sent, blind, blind, LOW, LOW]
    assert [(i, r.kind) for i, outcome in enumerate(found) for r in outcome.records] == [
        *((0, "missing"), (1, "missing")),
        *((2, "python error"), (4, "missing"), (5, "missing")),
    ]


def test_a_failsafe_one_that_inhibits() -> None:
    text = """
      robot r {
        sensor x : number from DServer.x
        actuator base { speed : m/s } to RServer.drive idle base(speed = 0)
      }
      failsafe module m from python "tests.verify.scripted_modules:Scripted" { reads x }
      module low { when true do base(speed = 1 m/s) }
      network { base = m inhibits low }
    """
    shots = [Frame(i * MS, {"x": x}) for i, x in enumerate((0, 1, 2, None))]
    idle, low = Decision("base", None, (0.0,)), Decision("base", "low", (1.0,))
    found = answered([{}, None, boom], *shots, text=text)
    assert [outcome.decisions[0] for outcome in found] == [idle, low, idle, idle]


def test_one_that_is_derived_from_a_failsafe_one() -> None:
    text = FAILSAFE.replace(
        "network { out = m ", "module more = m(width = 1 m)\nnetwork { out = more suppresses m "
    )
    [outcome] = answered([boom], shot(0), text=text)
    assert outcome.decisions == (Decision("out", "more", None, "missing"),)


def test_clients_keep_away_from_a_failsafe_one_that_has_no_answer() -> None:
    ordinary, failsafe = (
        client(text.replace("Scripted", "Unbuildable").replace("RATE", ""), "out", "low")
        for text in (TEXT, FAILSAFE)
    )
    for at, answer in enumerate((Answer(blind=True), Answer(error=True, blind=True))):
        assert ordinary.step(Frame(at, {}), {"m": answer}).active
        assert not failsafe.step(Frame(at, {}), {"m": answer}).active
    assert failsafe.step(Frame(2, {}), {"m": Answer()}).active


def test_the_client_of_a_failsafe_one_asks_for_the_idle_command_without_an_answer() -> None:
    one = client(FAILSAFE.replace("Scripted", "Unbuildable").replace("RATE", ""), "out", "m")
    step = one.step(shot(0), {"m": Answer(blind=True)})
    assert (step.active, step.values, step.fault, step.records) == (
        True,
        None,
        "missing",
        (("missing", "m"),),
    )
    assert one.step(shot(50), {"m": TOLD}).values == TOLD.values
    assert not one.step(shot(100), {"m": Answer()}).active


# --- classes that cannot be built, clients, observers --------------------------------------------


@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("no_such:X", "no_such"),
        ("tests.verify.scripted_modules:Missing", "Missing"),
        ("tests.verify.scripted_modules:Unbuildable", "no such device"),
        ("tests.verify.scripted_modules:Leaving", "SystemExit"),
    ],
)
def test_a_class_that_cannot_be_built_is_a_located_error(path: str, why: str) -> None:
    of = program(f'module m from python "{path}" {{ commands out }}\nnetwork {{ out = m }}')
    with pytest.raises(DiagnosticError, match=r"<text>:\d+:\d+: error\[P001\]"):
        Interpreter(of)
    for make in EXECUTORS.values():
        with pytest.raises(DiagnosticError, match=why):
            make(compilation(of))


def test_params_that_a_class_does_not_take() -> None:
    text = TEXT.replace("Scripted", "Unbuildable").replace("RATE", "")
    for make in EXECUTORS.values():
        with pytest.raises(DiagnosticError, match="unexpected keyword"):
            make(compilation(text))


def test_clients_ask_for_the_answers_of_python_modules() -> None:
    low = client(TEXT.replace("Scripted", "Unbuildable").replace("RATE", ""), "out", "low")
    assert low.python_modules == ("m",)
    assert not low.step(Frame(0, {}), {"m": TOLD}).active
    assert low.step(Frame(1, {}), {"m": Answer()}).active
    with pytest.raises(KeyError):
        low.step(Frame(2, {}))


def test_the_client_of_a_python_module_takes_its_answers_and_runs_nothing() -> None:
    one = client(TEXT.replace("Scripted", "Unbuildable").replace("RATE", ""), "out", "m")
    assert (one.sensors, one.python_modules) == ((), ("m",))
    assert one.step(shot(0), {"m": Answer()}).bid == "silent"
    assert one.step(shot(50), {"m": TOLD}).values == TOLD.values
    assert one.step(shot(100), {"m": Answer((nan, True, 67.0))}).fault == "not finite"


def test_a_python_module_alone() -> None:
    Scripted.answers = [GOOD, 42]
    compiled = compilation(TEXT.replace("RATE", "rate 300 ms")).compiled
    module = ModuleExecutor(compiled, "m")
    assert module.sensors == ("x", "a")
    for _ in range(2):
        assert module.step(shot(0)) == Answer(blind=True)
        assert module.step(shot(100)) == Answer(blind=True)
        assert module.step(shot(300)) == TOLD._replace(error=True)
        module.restart()
    with pytest.raises(KeyError):
        ModuleExecutor(compiled, "low")


def test_answers_that_are_given_decide_as_those_that_are_computed() -> None:
    shots, answers = there(3), (TOLD, Answer(), Answer(error=True))
    computed = answered([GOOD, None, 42], *shots)
    Scripted.built.clear()
    of = compilation(TEXT.replace("RATE", ""))
    given = ProgramExecutor(of.compiled, answers_given=True)
    interpreter = Interpreter(of.program, answers_given=True)
    for frame, answer, outcome in zip(shots, answers, computed, strict=True):
        assert repr(given.step(frame, {"m": answer})) == repr(outcome)
        assert repr(interpreter.step(frame, answers={"m": answer})) == repr(outcome)
    assert Scripted.built == []


OBSERVED = """
robot r {
  sensor x : number from DServer.x
  actuator out { v : number range 0 .. 1 } to DServer.Out idle hold
}
module seen from python "tests.verify.scripted_modules:Scripted" { reads x }
module also from python "tests.verify.scripted_modules:Scripted" { reads x }
module over { when x > 0 do out(v = x) }
network { out = over }
"""


def test_what_no_decision_asks_for_is_called_all_the_same_and_before_the_decision() -> None:
    found = answered([42] * 2, Frame(0, {"x": 5.0}), Frame(50 * MS, {"x": 0.5}), text=OBSERVED)
    errors = (("python error", "seen"), ("python error", "also"))
    assert [o.records for o in found] == [(*errors, ("command clamped", "out.v")), errors]
    assert Scripted.seen == [(t, {"x": x}) for t, x in ((0.0, 5.0), (0.05, 0.5)) for _ in range(2)]


def test_an_observer_alone_is_called_too() -> None:
    contract = "contract c: seen is active or x > 0\nnetwork { out = over }"
    text = OBSERVED.replace("network { out = over }", contract)
    [outcome] = answered([42], Frame(0, {"x": 0.0}), text=text)
    assert outcome.breaches == ("c",)
