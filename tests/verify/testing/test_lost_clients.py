"""With `on_loss degrade` every client makes of a loss what the reference makes of it: so does one that was
lost itself, when it is back and steps through the frames of its absence."""

from __future__ import annotations

from dataclasses import replace
from random import Random

import pytest

from colony.compile.lower.declarations import Declarations
from colony.execute.code import Kind, Lost
from colony.ir.frame import Answer, Frame
from colony.ir.program import Program
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import frame_in_base_units
from tests.drawn.strategies import run_of_seed
from tests.programs import MS, clients, program

Losses = tuple[frozenset[str], ...]


def degrading(of: Program) -> Program:
    actuators = tuple(replace(a, on_loss="degrade") for a in of.robot.actuators)
    return replace(of, robot=replace(of.robot, actuators=actuators))


def check(of: Program, trace: tuple[Frame, ...], losses: Losses) -> None:
    """In each frame exactly the winner is active by its own knowledge."""
    interpreter, alone = Interpreter(of), clients(of)
    for at, (frame, lost) in enumerate(zip(trace, losses, strict=True)):
        outcome = interpreter.step(frame, lost)
        told = {m.name: Answer((0.0,) * 8 if interpreter.is_active(m.name) else None) for m in of.modules}
        inside = frame_in_base_units(of, frame)
        active = {key for key, client in alone.items() if client.step(inside, told, lost).active}
        due = {(d.actuator, d.by) for d in outcome.decisions if d.by is not None}
        assert active == due, f"frame {at}, lost {sorted(lost)}"


def test_who_was_lost_did_not_dominate() -> None:
    """In frame 0 `back` is lost: its time constant has not begun when it is there again in frame 1."""
    of = program(
        "module back { when a do out(v = 1) }\nmodule side { when b do out(v = 2) }\n"
        "module cruise { when true do out(v = 3) }\n"
        "network { both = back suppresses side  out = (both suppresses[150 ms] back) suppresses cruise }"
    )
    trace = (
        Frame(0, {"a": True, "b": True}),
        Frame(100 * MS, {"a": False, "b": False}),
        Frame(120 * MS, {"a": True, "b": False}),
        Frame(300 * MS, {"a": False, "b": False}),
    )
    none = frozenset[str]()
    check(degrading(of), trace, (frozenset({"back"}), none, none, none))


GUARDED = """
failsafe module guard { when a do base(speed = 0.5 m/s, turn = 0) }
module high { when b do base(speed = 0.9 m/s, turn = 0) }
module cruise { when true do base(speed = 0.2 m/s, turn = 0) }
network { base = high suppresses guard suppresses[100 ms] cruise }
"""


GUARDED_FRAMES = [
    # a, b: the winner; with `guard` lost; with `guard` lost and an ordinary module
    (True, False, "guard", None, "cruise"),
    (False, False, None, None, "cruise"),  # its time constant
    (None, False, "guard", None, "cruise"),  # blind
    (None, True, "high", "high", "high"),  # dominated
    (True, True, "high", "high", "high"),
]


@pytest.mark.parametrize(
    ("word", "lost", "column"), [("failsafe", "", 2), ("failsafe", "guard", 3), ("", "guard", 4)]
)
def test_where_a_failsafe_module_is_lost_its_actuator_is_idle(word: str, lost: str, column: int) -> None:
    of = degrading(program(GUARDED.replace("failsafe", word)))
    trace = tuple(Frame(50 * i * MS, {"a": a, "b": b}) for i, (a, b, *_) in enumerate(GUARDED_FRAMES))
    interpreter, names = Interpreter(of), frozenset({lost} - {""})
    decisions = [interpreter.step(frame, names).commands["base"] for frame in trace]
    assert [d.by for d in decisions] == [row[column] for row in GUARDED_FRAMES]
    assert all(d.values == (0.0, 0.0) for d in decisions if d.by is None)
    check(of, trace, (names,) * len(trace))


def test_a_lost_failsafe_module_that_frees_the_others_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    def active_unless_lost(self: Declarations, module: str) -> int:
        lost = self.builder.add(Lost(module), Kind.BOOL)
        return self.builder.both(self.module_active(module), self.builder.negation(lost))

    monkeypatch.setattr(Declarations, "active_unless_lost", active_unless_lost)
    with pytest.raises(AssertionError, match=r"frame 0, lost \['guard'\]"):
        test_where_a_failsafe_module_is_lost_its_actuator_is_idle("failsafe", "guard", 3)
    test_where_a_failsafe_module_is_lost_its_actuator_is_idle("", "guard", 4)


@pytest.mark.parametrize("seed", range(60))
def test_drawn_networks_and_losses(seed: int) -> None:
    of, trace = run_of_seed(seed, network=True)
    chance = Random(seed)
    names = [m.name for m in of.modules if m.actuator is not None]
    losses = tuple(frozenset(n for n in names if chance.random() < 0.3) for _ in trace)
    check(degrading(of), trace, losses)
