"""Frames as a whole, in every executor: readings in, limits and ranges, commands out, records, contracts."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import pytest

from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.executor import ClientListExecutor, NotExclusive
from colony.ir.frame import Decision, Frame, Outcome, Record
from colony.verify.reference.interpreter import Interpreter


def _executors(text: str) -> dict[str, Any]:
    program = load_text(text)
    clients = compile_program(program).clients
    return {
        "priority": ClientListExecutor(program, clients),
        "exclusive": ClientListExecutor(program, clients, exclusive=True),
        "generated": load(generate(program, clients)),
        "interpreter": Interpreter(program),
    }


def _outcomes(text: str, *readings: dict[str, Any]) -> list[Outcome]:
    """The outcomes of one frame a second, which all executors agree on."""
    found: dict[str, list[Outcome]] = {}
    for name, executor in _executors(text).items():
        found[name] = [executor.step(Frame(i * 10**9, r)) for i, r in enumerate(readings)]
    for name, outcomes in found.items():
        assert repr(outcomes) == repr(found["interpreter"]), name
        for outcome in outcomes:
            assert all(type(d) is Decision for d in outcome.decisions)
            assert all(type(r) is Record for r in outcome.records)
    return found["priority"]


SENSOR = """
enum goal {{ none = 0, corner = 67, light = 76 }}
robot r {{
  sensor s : {} from DServer.s
  actuator out {{ v : number }} to DServer.Out idle hold
}}
module m {{ when true  do out(v = {}) }}
network {{ out = m }}
"""

FAULT, CLAMPED = "sensor fault", "sensor clamped"


@pytest.mark.parametrize(
    ("reading", "sent", "record"),
    [
        (2.0, 2000.0, None),
        (2, 2000.0, None),
        (11.0, 10000.0, CLAMPED),
        (-1, 500.0, CLAMPED),
        (inf, 10000.0, CLAMPED),
        (-inf, 500.0, CLAMPED),
        (10**400, 10000.0, CLAMPED),
        (-(10**400), 500.0, CLAMPED),
        (nan, None, FAULT),
        (True, None, FAULT),
        ("2", None, FAULT),
        ([2.0], None, FAULT),
        (None, None, None),
    ],
)
def test_a_number_comes_in(reading: Any, sent: float | None, record: str | None) -> None:
    text = SENSOR.format("m range 0.5 .. 10", "s / 1 mm")
    (outcome,) = _outcomes(text, {"s": reading})
    assert outcome.decisions[0].values == (None if sent is None else (sent,))
    assert outcome.records == (() if record is None else ((record, "s"),))


@pytest.mark.parametrize("reading", [inf, -inf, 1e308, 5])
def test_without_a_range_everything_but_nan_comes_in(reading: float) -> None:
    text = SENSOR.format("m", "if s > 1 m then 1 else if s < -1 m then 2 else 3")
    (outcome,) = _outcomes(text, {"s": reading})
    assert outcome.decisions[0].values == ((2.0,) if reading < 0 else (1.0,))
    assert outcome.records == ()


@pytest.mark.parametrize(
    ("reading", "sent", "record"),
    [
        ([1.0, 2.0, 3.0], 6.0, None),
        ((1.0, 2.0, 3.0), 6.0, None),
        ([1, 2.0, 3], 6.0, None),
        ([1.0, 20.0, -3.0], 11.0, CLAMPED),
        ([1.0, inf, -inf], 11.0, CLAMPED),
        ([1.0, 2.0], None, FAULT),
        ([1.0, nan, 3.0], None, FAULT),
        ([1.0, True, 3.0], None, FAULT),
        ([1.0, None, 3.0], None, FAULT),
        ([1.0, [2.0], 3.0], None, FAULT),
        ("123", None, FAULT),
        (1.0, None, FAULT),
        ({1.0, 2.0, 3.0}, None, FAULT),
        (None, None, None),
    ],
)
def test_an_array_of_numbers_comes_in(reading: Any, sent: float | None, record: str | None) -> None:
    text = SENSOR.format("number range 0 .. 10", "sum(s)").replace("sensor s", "sensor s[3]")
    (outcome,) = _outcomes(text, {"s": reading})
    assert outcome.decisions[0].values == (None if sent is None else (sent,))
    assert outcome.records == (() if record is None else ((record, "s"),))


def test_an_array_is_converted() -> None:
    text = SENSOR.format("ft range 0 .. 10", "sum(s) / 1 mm").replace("sensor s", "sensor s[3]")
    usual, unusual, over = _outcomes(text, {"s": [1.0, 2.0, 3.0]}, {"s": [1, 2, 3]}, {"s": [0.0, 11.0, 0.0]})
    assert usual.decisions == unusual.decisions
    assert over.decisions[0].values == (3048.0,)
    assert over.records == ((CLAMPED, "s"),)


@pytest.mark.parametrize(
    ("reading", "sent", "record"),
    [(True, 1.0, None), (False, 0.0, None), (1, None, FAULT), (1.0, None, FAULT), (None, None, None)],
)
def test_a_bool_comes_in(reading: Any, sent: float | None, record: str | None) -> None:
    (outcome,) = _outcomes(SENSOR.format("bool", "if s then 1 else 0"), {"s": reading})
    assert outcome.decisions[0].values == (None if sent is None else (sent,))
    assert outcome.records == (() if record is None else ((record, "s"),))


@pytest.mark.parametrize(
    ("reading", "sent", "record"),
    [([True, False], 1.0, None), ((True, True), 2.0, None), ([True, 1], None, FAULT), ([True], None, FAULT)],
)
def test_an_array_of_bools_comes_in(reading: Any, sent: float | None, record: str | None) -> None:
    text = SENSOR.format("bool", "count(s)").replace("sensor s", "sensor s[2]")
    (outcome,) = _outcomes(text, {"s": reading})
    assert outcome.decisions[0].values == (None if sent is None else (sent,))
    assert outcome.records == (() if record is None else ((record, "s"),))


@pytest.mark.parametrize(
    ("reading", "sent", "record"),
    [(67.0, 1.0, None), (67, 1.0, None), (0.0, 0.0, None), (5.0, None, FAULT), (nan, None, FAULT)],
)
def test_an_enumerator_comes_in(reading: Any, sent: float | None, record: str | None) -> None:
    for size, value in (("", reading), ("[2]", [0.0, reading])):
        text = SENSOR.format("goal", "if s" + ("[1]" if size else "") + " == goal.corner then 1 else 0")
        (outcome,) = _outcomes(text.replace("sensor s", f"sensor s{size}"), {"s": value})
        assert outcome.decisions[0].values == (None if sent is None else (sent,))
        assert outcome.records == (() if record is None else ((record, "s"),))


def test_a_default_stands_in_whatever_the_cause() -> None:
    text = SENSOR.format("number range 0 .. 9 default 4", "s + (if fresh(s) then 10 else 0)")
    missing, faulty, there = _outcomes(text, {}, {"s": nan}, {"s": 1.0})
    assert missing.decisions[0].values == (4.0,)
    assert (faulty.decisions[0].values, faulty.records) == ((4.0,), ((FAULT, "s"),))
    assert there.decisions[0].values == (11.0,)


# --- commands ------------------------------------------------------------------------------------

DRIVE = """
robot r {{
  sensor x : number from DServer.x
  sensor y : number from DServer.y
  sensor b : bool from DServer.b
  actuator drive {{ v : m/s range -1 .. 1, w : deg/s, on : bool }} to RServer.drive
    idle drive(v = 0.5 m/s, w = -0, on = true)
}}
module m {{ when b  do drive(v = x * 1 m/s, w = y * 1 deg/s, on = b) }}
network {{ drive = m }}
{}
"""


def test_commands_leave_in_declared_units() -> None:
    (outcome,) = _outcomes(DRIVE.format(""), {"x": 0.25, "y": 7.0, "b": True})
    assert outcome == Outcome((Decision("drive", "m", (0.25, 7.0, True)),))


def test_nobody_commands() -> None:
    quiet, missing = _outcomes(DRIVE.format(""), {"x": 0.25, "y": 7.0, "b": False}, {"x": 1.0, "b": True})
    assert quiet == missing == Outcome((Decision("drive", None, (0.5, 0.0, True)),))


def test_the_range_holds() -> None:
    low, high = _outcomes(DRIVE.format(""), {"x": -3.0, "y": 1.0, "b": True}, {"x": 2.0, "y": 1.0, "b": True})
    assert low.decisions[0].values == (-1.0, 1.0, True)
    assert high.decisions[0].values == (1.0, 1.0, True)
    assert low.records == high.records == (("command clamped", "drive.v"),)


@pytest.mark.parametrize("odd", [{"x": inf}, {"x": -inf}, {"y": inf}, {"x": 1e308}])
def test_what_is_not_finite_is_never_sent(odd: dict[str, float]) -> None:
    (outcome,) = _outcomes(DRIVE.format(""), {"x": 0.0, "y": 0.0, "b": True} | odd)
    assert outcome.decisions == (Decision("drive", "m", (0.5, 0.0, True), "not finite"),)
    assert outcome.records == (("not finite", "m"),)


def test_a_value_that_is_not_finite_when_it_leaves_is_not_sent() -> None:
    text = SENSOR.format("number", "s * 1 s").replace("v : number", "v : ms")
    (outcome,) = _outcomes(text, {"s": 1e307})
    assert outcome.decisions == (Decision("out", "m", None, "not finite"),)


def test_idle_hold_sends_nothing() -> None:
    (outcome,) = _outcomes(SENSOR.format("number", "s"), {"s": inf})
    assert outcome == Outcome((Decision("out", "m", None, "not finite"),), (Record("not finite", "m"),))


# --- limits --------------------------------------------------------------------------------------


def test_a_limit_lowers_and_is_recorded_before_the_range() -> None:
    text = DRIVE.format("limit drive.v <= 2 m/s\nlimit drive.w >= y * 1 deg/s + 3 deg/s when x > 1")
    (outcome,) = _outcomes(text, {"x": 3.0, "y": 1.0, "b": True})
    assert outcome.decisions[0].values == (1.0, 4.0, True)
    assert outcome.records == (
        ("limited", "drive.v"),
        ("command clamped", "drive.v"),
        ("limited", "drive.w"),
    )


def test_limits_apply_in_the_order_written() -> None:
    text = DRIVE.format("limit drive.w <= 2 deg/s\nlimit drive.w >= 5 deg/s\nlimit drive.w <= 4 deg/s")
    (outcome,) = _outcomes(text, {"x": 0.0, "y": 9.0, "b": True})
    assert outcome.decisions[0].values == (0.0, 4.0, True)
    assert outcome.records == (("limited", "drive.w"),)


LIMITED = """
robot r {
  sensor x : number from DServer.x
  sensor k : number from DServer.k
  sensor c : bool from DServer.c
  actuator out { v : number } to DServer.Out idle hold
}
module m { when true  do out(v = x) }
network { out = m }
"""


@pytest.mark.parametrize(
    ("k", "c", "sent"),
    [
        (5.0, True, 5.0),
        (5.0, False, 9.0),
        (None, False, 0.0),
        (None, True, 0.0),
        (5.0, None, 5.0),
        (inf, True, 0.0),
        (inf, False, 9.0),
        (None, None, 0.0),
    ],
)
def test_a_limit_that_reads_something_missing(k: float | None, c: bool | None, sent: float) -> None:
    text = LIMITED + "limit out.v <= k when c"
    (outcome,) = _outcomes(text, {"x": 9.0, "k": k, "c": c})
    assert outcome.decisions[0].values == (sent,)
    assert outcome.records == (() if sent == 9.0 else (("limited", "out.v"),))


def test_memory_of_condition_and_bound_moves_on_with_what_each_reads() -> None:
    text = LIMITED + "limit out.v <= previous(k, 1) when previous(c, false)"
    outcomes = _outcomes(
        text,
        {"x": 9.0, "k": 2.0, "c": None},
        {"x": 9.0, "k": None, "c": True},
        {"x": 9.0, "k": 3.0, "c": False},
        {"x": 9.0, "k": 4.0, "c": False},
    )
    assert [o.decisions[0].values for o in outcomes] == [(1.0,), (0.0,), (2.0,), (9.0,)]


def test_idle_commands_are_not_limited() -> None:
    (outcome,) = _outcomes(DRIVE.format("limit drive.v <= 0"), {"x": 1.0, "y": 1.0, "b": False})
    assert outcome.decisions[0].values == (0.5, 0.0, True)


# --- contracts -----------------------------------------------------------------------------------


def test_contracts_read_decisions() -> None:
    text = DRIVE.format(
        "contract sent: drive.v <= 0.5 m/s\n"
        "contract won: not (drive by m)\n"
        "contract commanded: not (drive is commanded)\n"
        "contract idle: drive is commanded\n"
        "contract active: not (m is active)\n"
    )
    frames = [
        {"x": 3.0, "y": 0.0, "b": True},
        {"x": inf, "y": 0.0, "b": True},
        {"x": 3.0, "y": 0.0, "b": False},
    ]
    sent, faulty, idle = (o.breaches for o in _outcomes(text, *frames))
    assert sent == ("sent", "won", "commanded", "active")
    assert faulty == ("won", "idle", "active")
    assert idle == ("idle",)


def test_contracts_say_nothing_about_what_is_missing() -> None:
    text = LIMITED.replace("when true", "let twice = x * 2  when c") + (
        "contract held: out.v < 0\ncontract let_: m.twice < 0\ncontract memory: previous(out.v, 0) < 5\n"
    )
    frames = [{"x": 9.0, "c": True}, {"x": 9.0, "c": False}, {"c": True}, {"x": 9.0, "c": True}]
    outcomes = _outcomes(text, *frames)
    assert [o.breaches for o in outcomes] == [("held", "let_"), ("let_",), (), ("held", "let_", "memory")]


def test_contracts_see_wires_and_old_states() -> None:
    text = DRIVE.format("state n = 0\nnext n = n + 1\ncontract wire: w is active implies n < 1\n")
    text = text.replace("network { drive = m }", "network { w = m  drive = w }")
    assert "w = m" in text
    first, second = _outcomes(text, *[{"x": 0.0, "y": 0.0, "b": True}] * 2)
    assert (first.breaches, second.breaches) == ((), ("wire",))


# --- arbitration ---------------------------------------------------------------------------------


def test_two_exclusive_guards_that_hold_are_an_error() -> None:
    program = load_text(
        DRIVE.format("").replace("drive = m", "drive = m suppresses n")
        + "module n { when b  do drive(v = 0, w = 0, on = b) }"
    )
    clients = compile_program(program).clients
    (drive,) = clients.actuators
    first = drive.clients[0]
    wrong = [
        type(c)(module=c.module, priority=c.priority, guard=c.guard, exclusive=c.guard) for c in drive.clients
    ]
    broken = type(clients)(
        guards=clients.guards, actuators=(type(drive)(actuator="drive", clients=tuple(wrong)),)
    )
    executor = ClientListExecutor(program, broken, exclusive=True)
    with pytest.raises(NotExclusive, match="drive: m, n"):
        executor.step(Frame(0, {"x": 0.0, "y": 0.0, "b": True}))
    assert first.module == "m"


def test_an_actuator_that_nothing_drives_is_idle() -> None:
    text = DRIVE.format("contract calm: drive is commanded or drive.v < 0").replace(
        "network { drive = m }", ""
    )
    (outcome,) = _outcomes(text, {"x": 0.0, "y": 0.0, "b": True})
    assert outcome == Outcome((Decision("drive", None, (0.5, 0.0, True)),), (), ("calm",))


def test_two_actuators_and_shared_values() -> None:
    text = """
robot r {
  sensor x : number range 0 .. 100 from DServer.x
  sensor b : bool from DServer.b
  actuator one { v : number } to DServer.One idle one(v = 0)
  actuator two { v : number } to DServer.Two idle two(v = 0)
}
let half = x / 2
module a { when half > 10  do one(v = half) }
module c { when half < 5  do one(v = -half) }
module d { when b and half > 10  do two(v = half + 1) }
network { one = a suppresses c  two = a inhibits d }
"""
    first, second = _outcomes(text, {"x": 40.0, "b": True}, {"x": 4.0, "b": True})
    assert [d.by for d in first.decisions] == ["a", None]
    assert second.decisions == (Decision("one", "c", (-2.0,)), Decision("two", None, (0.0,)))
