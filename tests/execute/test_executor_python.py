"""Modules written in Python, in every executor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, nan
from typing import Any, ClassVar

import pytest

from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.executor import ClientExecutor, ClientListExecutor
from colony.ir.frame import Decision, Frame, Outcome
from colony.text.diagnostics import Failure
from colony.verify.reference.interpreter import Interpreter


class Told:
    """Answers what `answer` gives for the frame; remembers what it was given and built with."""

    answer: ClassVar[Callable[[Mapping[str, Any]], object]] = staticmethod(lambda frame: None)
    given: ClassVar[list[tuple[float, dict[str, object]]]] = []
    params: ClassVar[dict[str, float]] = {}

    def __init__(self, **params: float) -> None:
        type(self).params = params

    def step(self, frame: Any) -> object:
        assert isinstance(frame, Mapping)
        self.given.append((frame.t, dict(frame)))
        return type(self).answer(frame)


class Unbuildable:
    def __init__(self) -> None:
        raise OSError("no such device")


TEXT = """
enum mood {{ calm = 0, alert = 67 }}
robot r {{
  sensor x : m from DServer.x
  sensor a[2] : bool from DServer.a
  actuator out {{ v : mm, on : bool, mood : mood }} to DServer.Out idle hold
}}
let twice = x * 2
state n = 5
next n = n + 1
module m from python "{path}:{name}" {{
  param width = 1.5 m
  reads x, a, twice, n
  commands out
  {rate}
}}
module low {{ when true  do out(v = 0, on = false, mood = mood.calm) }}
network {{ out = m suppresses low }}
"""


def _text(name: str = "Told", rate: str = "") -> str:
    return TEXT.format(path=__name__, name=name, rate=rate)


def _outcomes(text: str, frames: list[Frame]) -> list[Outcome]:
    program = load_text(text)
    clients = compile_program(program).clients
    executors: dict[str, Callable[[], Any]] = {
        "priority": lambda: ClientListExecutor(program, clients),
        "exclusive": lambda: ClientListExecutor(program, clients, exclusive=True),
        "generated": lambda: load(generate(program, clients)),
        "interpreter": lambda: Interpreter(program),
    }
    found: dict[str, tuple[list[Outcome], list[Any]]] = {}
    for name, make in executors.items():
        Told.given.clear()
        executor = make()
        found[name] = [executor.step(frame) for frame in frames], list(Told.given)
    for name, result in found.items():
        assert repr(result) == repr(found["interpreter"]), name
    Told.given[:] = found["priority"][1]
    return found["priority"][0]


def _frame(seconds: float, **readings: Any) -> Frame:
    return Frame(round(seconds * 1e9), {"x": 0.5, "a": [True, False]} | readings)


GOOD = {"v": 3, "on": True, "mood": 67}


def _tell(monkeypatch: pytest.MonkeyPatch, answer: object) -> None:
    monkeypatch.setattr(Told, "answer", staticmethod(lambda _: answer))


def test_what_it_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    _tell(monkeypatch, GOOD)
    _outcomes(_text(), [_frame(10), _frame(10.25, x=2)])
    assert Told.params == {"width": 1500.0}
    assert repr(Told.given) == repr(
        [
            (0.0, {"x": 500.0, "a": (True, False), "twice": 1000.0, "n": 5.0}),
            (0.25, {"x": 2000.0, "a": (True, False), "twice": 4000.0, "n": 6.0}),
        ]
    )


def test_a_snapshot_cannot_be_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(frame: Any) -> object:
        frame.t = 3.0
        return GOOD

    monkeypatch.setattr(Told, "answer", staticmethod(answer))
    program = load_text(_text())
    clients = compile_program(program).clients
    for executor in (ClientListExecutor(program, clients), load(generate(program, clients))):
        assert executor.step(_frame(0)).records == (("python error", "m"),)


def test_a_command(monkeypatch: pytest.MonkeyPatch) -> None:
    _tell(monkeypatch, GOOD)
    (outcome,) = _outcomes(_text(), [_frame(0)])
    assert outcome == Outcome((Decision("out", "m", (3.0, True, 67.0)),))


def test_not_applicable(monkeypatch: pytest.MonkeyPatch) -> None:
    _tell(monkeypatch, None)
    (outcome,) = _outcomes(_text(), [_frame(0)])
    assert (outcome.decisions[0].by, outcome.records) == ("low", ())


def test_it_is_not_called_where_something_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    _tell(monkeypatch, GOOD)
    outcomes = _outcomes(_text(), [_frame(0, a=None), _frame(1, x=nan), _frame(2)])
    assert [o.decisions[0].by for o in outcomes] == ["low", "low", "m"]
    assert [t for t, _ in Told.given] == [2.0]


@pytest.mark.parametrize(
    "answer",
    [
        {"v": 3, "on": True},
        GOOD | {"more": 1},
        GOOD | {"v": True},
        GOOD | {"v": "3"},
        GOOD | {"v": None},
        GOOD | {"on": 1},
        GOOD | {"mood": 5},
        GOOD | {"mood": nan},
        5,
        [],
        "von",
    ],
)
def test_a_wrong_answer_is_silence_and_recorded(monkeypatch: pytest.MonkeyPatch, answer: object) -> None:
    _tell(monkeypatch, answer)
    (outcome,) = _outcomes(_text(), [_frame(0)])
    assert (outcome.decisions[0].by, outcome.records) == ("low", (("python error", "m"),))


def test_what_it_raises_is_silence_and_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(frame: Mapping[str, Any]) -> object:
        raise KeyError(frame["nothing"])

    monkeypatch.setattr(Told, "answer", staticmethod(answer))
    (outcome,) = _outcomes(_text(), [_frame(0)])
    assert (outcome.decisions[0].by, outcome.records) == ("low", (("python error", "m"),))


@pytest.mark.parametrize("value", [nan, inf, 10**400], ids=["nan", "inf", "huge"])
def test_a_command_that_is_not_finite_wins_and_is_not_sent(
    monkeypatch: pytest.MonkeyPatch, value: float
) -> None:
    _tell(monkeypatch, GOOD | {"v": value})
    (outcome,) = _outcomes(_text(), [_frame(0)])
    assert outcome.decisions == (Decision("out", "m", None, "not finite"),)
    assert outcome.records == (("not finite", "m"),)


def test_with_a_rate_an_answer_takes_effect_when_the_next_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(frame: Mapping[str, Any]) -> object:
        if frame["x"] == 4000.0:
            raise ValueError
        return None if frame["x"] == 3000.0 else GOOD | {"v": frame["x"]}

    monkeypatch.setattr(Told, "answer", staticmethod(answer))
    frames = [
        _frame(1, x=None),
        _frame(2, x=1.0),  # called
        _frame(2.2, x=9.0),
        _frame(2.3, x=2.0),  # in effect, called
        _frame(2.4, x=None),  # silent, but the answer stands
        _frame(2.5, x=9.0),
        _frame(2.7, x=3.0),  # called
        _frame(3, x=4.0),  # called
        _frame(3.3, x=5.0),
    ]
    outcomes = _outcomes(_text(rate="rate 300 ms"), frames)
    sent = [o.decisions[0].values[0] if o.decisions[0].by == "m" else None for o in outcomes]
    assert sent == [None, None, None, 1000.0, None, 1000.0, 2000.0, None, None]
    assert [t for t, _ in Told.given] == [1.0, 1.3, 1.7, 2.0, 2.3]
    assert [bool(o.records) for o in outcomes] == [False] * 7 + [True, False]


def test_a_class_that_cannot_be_built_is_told_of() -> None:
    for name, why in (("Unbuildable", "unexpected keyword"), ("Nothing", "Nothing")):
        program = load_text(_text(name))
        clients = compile_program(program).clients
        with pytest.raises(Failure, match=why):
            ClientListExecutor(program, clients)
        with pytest.raises(Failure, match=why):
            load(generate(program, clients))


def test_clients_ask_for_the_activity_of_python_modules_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    _tell(monkeypatch, GOOD)
    program = load_text(_text("Unbuildable"))
    clients = compile_program(program).clients
    low = ClientExecutor(program, clients, "out", "low")
    assert low.outside == ("m",)
    assert not low.step(Frame(0, {}), {"m": True}).active
    assert low.step(Frame(1, {}), {"m": False}).active
    with pytest.raises(KeyError):
        low.step(Frame(2, {}))


def test_the_client_of_a_python_module(monkeypatch: pytest.MonkeyPatch) -> None:
    _tell(monkeypatch, GOOD)
    program = load_text(_text(rate="rate 300 ms"))
    clients = compile_program(program).clients
    client = ClientExecutor(program, clients, "out", "m")
    assert (client.sensors, client.outside) == (("x", "a"), ())
    assert not client.step(_frame(0)).active
    other = ClientExecutor(program, clients, "out", "m")
    other.memory = client.memory
    for each in (client, other):
        assert each.step(_frame(0.3)).values == (3.0, True, 67.0)


OBSERVED = f"""
robot r {{
  sensor x : number from DServer.x
  actuator out {{ v : number range 0 .. 1 }} to DServer.Out idle hold
}}
module seen from python "{__name__}:Told" {{ reads x }}
module also from python "{__name__}:Told" {{ reads x }}
module over {{ when x > 0 do out(v = x) }}
network {{ out = over }}
"""


def test_what_no_decision_asks_for_is_called_all_the_same_and_before_the_decision(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _tell(monkeypatch, 42)
    outcomes = _outcomes(OBSERVED, [Frame(0, {"x": 5.0}), Frame(50_000_000, {"x": 0.5})])
    errors = (("python error", "seen"), ("python error", "also"))
    assert [o.records for o in outcomes] == [(*errors, ("command clamped", "out.v")), errors]
    assert Told.given == [(t, {"x": x}) for t, x in ((0.0, 5.0), (0.05, 0.5)) for _ in range(2)]


def test_an_observer_alone_is_called_too(monkeypatch: pytest.MonkeyPatch) -> None:
    _tell(monkeypatch, 42)
    text = OBSERVED.replace(
        "network { out = over }", "contract c: seen is active or x > 0\nnetwork { out = over }"
    )
    (outcome,) = _outcomes(text, [Frame(0, {"x": 0.0})])
    assert outcome.breaches == ("c",)
