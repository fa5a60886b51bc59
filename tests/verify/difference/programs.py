"""Pairs of small programs for one robot."""

from __future__ import annotations

from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.verify.contracts.results import RESOURCES_PER_SECOND, ProofOptions
from colony.verify.difference import Different, Result, difference
from colony.verify.reference.interpreter import Interpreter
from tests.verify.small_robot import robot

ROBOT = robot("actuator lamp { on : bool } to DServer.Lamp idle hold")
QUICK = ProofOptions(depth=2, max_frames=6, resources=2 * RESOURCES_PER_SECOND)
"""A budget in z3's own units alone: on a busy machine a question takes longer, and has the same answer."""


def program(text: str) -> Program:
    return load_text(ROBOT + text)


def compare(a: str, b: str, *ignore: str) -> Result:
    """The result; a difference is seen again in the reference interpreter."""
    one, other = program(a), program(b)
    result = difference(one, other, ignore, options=QUICK)
    if isinstance(result, Different):
        seen = []
        for each in (one, other):
            interpreter = Interpreter(each)
            seen.append([interpreter.step_in_base_units(s.t_ns, s.readings) for s in result.snapshots])
        assert seen == [list(result.a), list(result.b)]
        sent = [[[d.values for d in frame.decisions] for frame in run] for run in seen]
        assert sent[0][-1] != sent[1][-1]
    return result


def verdict(a: str, b: str, *ignore: str) -> str:
    return type(compare(a, b, *ignore)).__name__
