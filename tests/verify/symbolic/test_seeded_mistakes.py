"""Mistakes put into the encoding on purpose: the comparison with the interpreter notices each."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from random import Random
from typing import Any

import pytest
import z3

from colony.ir.frame import Frame, Reading
from colony.ir.program import Machine, Module, Transition
from colony.verify.symbolic import arithmetic, inputs, memory, modules, network, numbers
from colony.verify.symbolic.logic import FALSE, TRUE, both, either, integer, negation
from colony.verify.symbolic.numbers import select_number
from colony.verify.symbolic.system import ExtendedReal, ModuleTerms
from tests.verify.symbolic.programs import program
from tests.verify.symbolic.trust import Trust
from tests.verify.testing.bugs_in_failsafe import as_ordinary, kept_by_those_above, passed_over

PROGRAM = """
machine phase { start resting  resting -> going when p  any -> resting when x > 500 mm }
state n : number = 0
next n = if p then 0 else n + 1
let near = recently(x >= 500 mm, 100 ms)
let far = a > x
let before = previous(n, 7)
let since = elapsed(p)
let late = every(100 ms)
let kept = captured(x, p)
let which = s[clamp(x / 1 mm, 0, 9)]
let set = latch(p, q)
let turned = mod(a / 1 mm, 7)
module m {
  let close = recently(x < 500 mm, 50 ms)
  state y : mm = 1 mm
  next y = x
  when fresh(q) and close
  do drive(v = a / 1 s)
}
module other { when true  do drive(v = -20 mm/s) }
module lamp { when p  do light(level = a / 1 mm) }
network {
  drive = m suppresses[100 ms] other
  light = m inhibits[50 ms] lamp
}
limit drive.v <= 100 mm/s when p
limit drive.v >= -x / 1 s
contract c: light.level < 4
contract d: recently(m is active, 100 ms) or phase == phase.going or near
"""


FAILSAFE = """
machine phase {
  start resting
  failsafe resting -> going    when x > 500 mm
           going   -> stuck    when x < 300 mm
           going   -> resting  when p
  failsafe going   -> stuck    when q
           stuck   -> resting  when p and q
}
failsafe module m {
  state n : number = 0
  next n = n + 1
  when x < 500 mm
  do drive(v = -n * 1 mm/s)
}
module other { when true  do drive(v = 20 mm/s) }
failsafe module guard { when p }
module lamp { when phase == phase.going  do light(level = a / 1 mm) }
network {
  drive = m suppresses[100 ms] other
  light = guard inhibits lamp
}
contract c: light.level < 4
"""


def trace(seed: int) -> list[Frame]:
    """Readings that matter to the program, infinite and missing ones among them."""
    random, t_ns, frames = Random(seed), 0, []
    for _ in range(8):
        readings: dict[str, Reading] = {
            "a": random.choice([None, 0.0, -3.5, 40.0, 300.0, math.inf, -math.inf]),
            "x": random.choice([None, 2.5, 300.0, 500.0, 700.0]),
            "s": (1.0, 2.0, 3.0, 4.0, 5.0),
            "p": random.choice([None, True, False]),
            "q": random.choice([None, True, False]),
        }
        frames.append(Frame(t_ns, readings))
        t_ns += random.choice([50_000_000, 50_000_000, 100_000_000, 99_999_999])
    return frames


def differences(text: str) -> list[str]:
    trust = Trust(program(text))
    return [d for seed in range(12) for d in trust.run(trace(seed)).differences]


@pytest.mark.parametrize("text", [PROGRAM, FAILSAFE], ids=["program", "failsafe"])
def test_without_a_mistake_there_is_no_difference(text: str) -> None:
    assert not differences(text)


# --- the mistakes --------------------------------------------------------------------------------

Patch = Callable[[pytest.MonkeyPatch], None]


def held_too_long(patch: pytest.MonkeyPatch) -> None:
    def recently(self: memory.Memory, b: z3.BoolRef, duration_ns: int) -> z3.BoolRef:
        ever, time = self._time_of(both(self.advances, b))
        return either(b, both(ever, self.frame_values.now - time <= integer(duration_ns)))

    patch.setattr(memory.Memory, "recently", recently)


def memory_moves_while_silent(patch: pytest.MonkeyPatch) -> None:
    original = memory.Memory.__init__

    def always(self: memory.Memory, builder: Any, frame_values: Any, advances: z3.BoolRef, hint: str) -> None:
        original(self, builder, frame_values, TRUE, hint)

    patch.setattr(memory.Memory, "__init__", always)


def a_default_is_fresh(patch: pytest.MonkeyPatch) -> None:
    original = modules.DeclarationEncoder.encode_states

    def encode_states(self: modules.DeclarationEncoder) -> None:
        self.frame_values.present["q"] = TRUE
        original(self)

    patch.setattr(modules.DeclarationEncoder, "encode_states", encode_states)


def a_default_is_not_used(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(inputs, "default_of", lambda sensor: None)


def a_time_constant_is_forgotten(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(network.NetworkEncoder, "_dominates", lambda self, active, window_ns, hint: active)


def a_suppressor_inhibits(patch: pytest.MonkeyPatch) -> None:
    original = network._Chain
    patch.setattr(network, "_Chain", lambda operands, open_, merges: original(operands, open_, False))


def a_limit_needs_what_it_reads(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(network, "missing", lambda e, frame_values: FALSE)


def only_the_first_limit_counts(patch: pytest.MonkeyPatch) -> None:
    original = network._bounded

    def bounded(x: ExtendedReal, field: Any, bounds: Sequence[Any]) -> ExtendedReal:
        return original(x, field, bounds[:1])

    patch.setattr(network, "_bounded", bounded)


def what_is_not_finite_is_sent(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(network, "finite", lambda x: negation(x.nan))


def halves_round_up(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(arithmetic, "_reaches", lambda x, n: x >= z3.Q(2 * n - 1, 2))


def set_wins_over_reset(patch: pytest.MonkeyPatch) -> None:
    original = memory.Memory.latch

    def latch(self: memory.Memory, set_: z3.BoolRef, reset: z3.BoolRef) -> z3.BoolRef:
        return either(set_, original(self, set_, reset))

    patch.setattr(memory.Memory, "latch", latch)


def the_key_is_not_looked_at(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(memory, "equal", lambda x, y: TRUE)


def an_infinity_is_its_sign(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(numbers, "_infinite_comparison", lambda x, y, relation, swapped: FALSE)


def the_remainder_has_the_sign_of_the_dividend(patch: pytest.MonkeyPatch) -> None:
    original = arithmetic.Arithmetic._modulo_by_constant

    def modulo(self: arithmetic.Arithmetic, x: ExtendedReal, divisor: float) -> ExtendedReal:
        result = original(self, x, divisor)
        return select_number(numbers.negative_value(x), numbers.negated(result), result)

    patch.setattr(arithmetic.Arithmetic, "_modulo_by_constant", modulo)


def every_is_due_a_moment_late(patch: pytest.MonkeyPatch) -> None:
    original = memory.Memory.every

    def every(self: memory.Memory, duration_ns: int) -> z3.BoolRef:
        return original(self, duration_ns + 1)

    patch.setattr(memory.Memory, "every", every)


def elapsed_begins_a_frame_late(patch: pytest.MonkeyPatch) -> None:
    original = memory.Memory.elapsed_ns

    def elapsed(self: memory.Memory, b: z3.BoolRef) -> z3.ArithRef:
        return original(self, both(b, memory._truth(self.last(b, memory.Bool(), False))))

    patch.setattr(memory.Memory, "elapsed_ns", elapsed)


MISTAKES: list[Patch] = [
    held_too_long,
    memory_moves_while_silent,
    a_default_is_fresh,
    a_default_is_not_used,
    a_time_constant_is_forgotten,
    a_suppressor_inhibits,
    a_limit_needs_what_it_reads,
    only_the_first_limit_counts,
    what_is_not_finite_is_sent,
    halves_round_up,
    set_wins_over_reset,
    the_key_is_not_looked_at,
    an_infinity_is_its_sign,
    the_remainder_has_the_sign_of_the_dividend,
    every_is_due_a_moment_late,
    elapsed_begins_a_frame_late,
]


def terms(change: Callable[[ModuleTerms], ModuleTerms]) -> Patch:
    """`change` the terms of every module that is failsafe."""

    def mistake(patch: pytest.MonkeyPatch) -> None:
        original = modules.DeclarationEncoder._module

        def module(self: modules.DeclarationEncoder, of: Module) -> ModuleTerms:
            return change(original(self, of)) if of.failsafe else original(self, of)

        patch.setattr(modules.DeclarationEncoder, "_module", module)

    return mistake


def without_blindness(of: ModuleTerms) -> ModuleTerms:
    return replace(of, active=both(of.applicable, negation(of.silent)))


def transitions(change: Callable[[Transition], Transition]) -> Patch:
    """`change` the transitions of machines."""

    def mistake(patch: pytest.MonkeyPatch) -> None:
        original = modules.DeclarationEncoder._machine

        def encoded(self: modules.DeclarationEncoder, machine: Machine) -> None:
            original(self, replace(machine, transitions=tuple(map(change, machine.transitions))))

        patch.setattr(modules.DeclarationEncoder, "_machine", encoded)

    return mistake


FAILSAFE_MISTAKES: dict[str, Patch] = {
    "blind modules are silent": terms(lambda of: replace(without_blindness(of), blind=FALSE)),
    "blind modules are not active": terms(without_blindness),
    "blind modules send a command": terms(lambda of: replace(of, blind=FALSE)),
    "transitions below a missing one are taken": transitions(passed_over),
    "failsafe transitions are not taken where missing": transitions(as_ordinary),
    "failsafe transitions are kept by a missing one": transitions(kept_by_those_above),
}


@pytest.mark.parametrize(
    ("text", "mistake"),
    [
        *(pytest.param(PROGRAM, mistake, id=mistake.__name__) for mistake in MISTAKES),
        *(pytest.param(FAILSAFE, mistake, id=name) for name, mistake in FAILSAFE_MISTAKES.items()),
    ],
)
def test_the_mistake_is_noticed(text: str, mistake: Patch, monkeypatch: pytest.MonkeyPatch) -> None:
    mistake(monkeypatch)
    try:
        found = differences(text)
    except AssertionError as problem:
        found = [str(problem)]
    assert found
