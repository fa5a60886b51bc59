"""Single clients, each with the view of the program that it needs, and what they remember."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.execute.executor import ClientMemory
from colony.ir.frame import Frame
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.strategies import traces
from tests.drawn.strategies import networks, programs
from tests.programs import OneClient, client, clients, compilation

TEXT = """
robot r {
  sensor x : number range 0 .. 10 from DServer.x
  sensor y : number from DServer.y
  sensor z : number from DServer.z
  sensor b : bool from DServer.b
  actuator out { v : m range 0 .. 5 } to DServer.Out idle out(v = 0) on_loss %s
  actuator other { v : number } to DServer.Other idle hold
}
let far = previous(z, 0)
module high { when recently(b, 1 s)  do out(v = far * y * 1 m) }
module low { when x > 0  do out(v = x * 1 m) }
module apart { when z > 0  do other(v = z) }
network { out = high suppresses[2 s] low  other = apart }
limit out.v <= 3 m when x > 5
contract c: previous(z, 0) < 10
"""


def _client(module: str, on_loss: str = "stop", actuator: str = "out") -> OneClient:
    return client(TEXT % on_loss, actuator, module)


def test_a_client_reads_only_what_it_needs() -> None:
    assert _client("apart", actuator="other").sensors == ("z",)
    assert _client("high").sensors == ("x", "y", "z", "b")
    low = _client("low")
    assert low.sensors == ("x", "y", "z", "b")  # `high` is silent without y and z
    assert {cell.name for cell in low.code.cells} == {"high held 2 until", "guard 2 until"} or (
        len(low.code.cells) == 2
    )
    assert low.code.contracts == ()


def test_a_command_within_limits_and_range() -> None:
    low = _client("low")
    quiet = {"y": 0.0, "z": 0.0, "b": False}
    assert low.step(Frame(0, quiet | {"x": 2.0}))[:3] == (True, (2000.0,), None)
    limited = low.step(Frame(1, quiet | {"x": 20.0}))
    assert limited.values == (3000.0,)
    assert limited.records == (("sensor clamped", "x"), ("limited", "out.v"))
    assert low.step(Frame(2, quiet | {"x": 0.0}))[:2] == (False, None)


def test_a_command_that_does_not_win_is_not_bounded() -> None:
    low = _client("low")
    first = {"x": 20.0, "y": 1.0, "z": 1.0, "b": True}
    silent = low.step(Frame(0, first))
    assert (silent.active, silent.values, silent.records) == (False, None, (("sensor clamped", "x"),))


def test_a_command_that_is_not_finite() -> None:
    high = _client("high")
    frame = {"x": 0.0, "y": float("inf"), "z": 1.0, "b": True}
    step = high.step(Frame(0, frame))
    assert (step.active, step.values, step.fault) == (True, None, "not finite")
    assert step.records == (("not finite", "high"),)


@pytest.mark.parametrize(("on_loss", "takes_over"), [("stop", False), ("degrade", True)])
def test_what_a_lost_client_does(on_loss: str, takes_over: bool) -> None:
    low = _client("low", on_loss)
    frame = {"x": 2.0, "y": 1.0, "z": 1.0, "b": True}
    assert not low.step(Frame(0, frame)).active
    later = frame | {"b": False}
    assert not low.step(Frame(2 * 10**9, frame)).active
    assert low.step(Frame(6 * 10**9, frame), lost=frozenset({"high"})).active == takes_over
    assert low.step(Frame(7 * 10**9, later)).active == takes_over


def test_there_must_be_such_a_client() -> None:
    with pytest.raises(KeyError):
        _client("nobody")
    with pytest.raises(KeyError):
        _client("high", actuator="other")


def test_memory_survives_as_plain_data() -> None:
    high = _client("high")
    high.step(Frame(5, {"x": 0.0, "y": 1.0, "z": 2.0, "b": True}))
    stored = json.loads(json.dumps(high.memory._asdict()))
    again = _client("high")
    again.memory = ClientMemory(**stored)
    assert again.memory == high.memory
    frame = Frame(10**9, {"x": 0.0, "y": 1.0, "z": 7.0, "b": False})
    assert again.step(frame) == high.step(frame)
    assert again.memory == high.memory


def test_memory_of_another_client_is_refused() -> None:
    high = _client("high")
    with pytest.raises(ValueError, match="another client"):
        high.memory = ClientMemory(0, {"x": 1.0})
    cells = high.memory.cells
    name = next(iter(cells))
    with pytest.raises(ValueError, match=name):
        high.memory = ClientMemory(0, cells | {name: "x"})


@given(data=st.data())
def test_a_client_that_was_started_anew_goes_on_as_the_other(data: st.DataObject) -> None:
    program = data.draw(programs(python=False))
    trace = data.draw(traces(program))
    compiled = compilation(program).compiled
    for actuator, module, _ in compiled.clients:
        one = OneClient(compiled, actuator, module)
        for frame in trace:
            other = OneClient(compiled, actuator, module)
            other.memory = one.memory
            assert repr(other.step(frame)) == repr(one.step(frame))
            assert repr(other.memory) == repr(one.memory)


# --- why a client is not active --------------------------------------------------------------------

WHY = """
robot r {
  sensor a : bool from DServer.a
  sensor b : bool from DServer.b
  sensor c : bool from DServer.c
  actuator out { v : number } to DServer.Out idle out(v = 0)
}
module top { when a  do out(v = 1) }
module gate { when b }
module low { when c  do out(v = 2) }
network { out = %s }
"""


def _bids(wiring: str, module: str, *frames: str) -> list[str]:
    """Bids of a module in frames in which the sensors named are true, a tenth of a second apart."""
    one = client(WHY % wiring, "out", module)
    trace = [Frame(k * 10**8, {name: name in true for name in "abc"}) for k, true in enumerate(frames)]
    return [one.step(frame).bid for frame in trace]


def test_why_a_client_is_not_active() -> None:
    wiring = "top suppresses (gate inhibits low)"
    frames = ("", "c", "ac", "bc", "abc", "a")
    assert _bids(wiring, "low", *frames) == [
        "inactive",
        "command",
        "suppressed",
        "inhibited",
        "inhibited",
        "inactive",
    ]
    assert _bids(wiring, "top", *frames) == [
        "inactive",
        "inactive",
        "command",
        "inactive",
        "command",
        "command",
    ]


def test_a_missing_sensor_is_silence() -> None:
    low = client(WHY % "top suppresses low", "out", "low")
    assert low.step(Frame(0, {"a": True, "b": False})).bid == "silent"
    assert low.step(Frame(1, {"c": True})).bid == "command"


def test_a_time_constant_keeps_the_gate_closed() -> None:
    assert _bids("gate inhibits[150 ms] low", "low", "bc", "c", "c") == ["inhibited", "inhibited", "command"]


def test_a_module_with_several_ways_is_suppressed_whatever_closed_them() -> None:
    wiring = "(gate inhibits low) suppresses (top suppresses low)"
    assert _bids(wiring, "low", "c", "bc", "abc", "b") == ["command", "command", "suppressed", "inactive"]


def test_a_gate_that_never_opens_inhibits() -> None:
    assert _bids("top suppresses (low inhibits low)", "low", "c", "") == ["inhibited", "inactive"]


@given(st.data())
def test_bids_are_what_the_network_says(data: st.DataObject) -> None:
    program = data.draw(networks())
    interpreter, alone = Interpreter(program), clients(program)
    for frame in data.draw(traces(program)):
        winners = {d.actuator: d.by for d in interpreter.step(frame).decisions}
        for (actuator, module), one in alone.items():
            bid = one.step(frame).bid
            assert (bid == "command") == (winners[actuator] == module)
            assert (bid in ("inactive", "silent")) == (not interpreter.is_active(module))
            assert (bid == "silent") == interpreter.is_silent(module)


def test_from_the_initial_memory_again() -> None:
    high = _client("high")
    fresh = high.memory
    frame = {"x": 0.0, "y": 1.0, "z": 2.0, "b": True}
    first = [high.step(Frame(t * 10**9, frame)) for t in (3, 4)]
    high.restart()
    assert high.memory == fresh
    assert [high.step(Frame(t * 10**9, frame)) for t in (3, 4)] == first
