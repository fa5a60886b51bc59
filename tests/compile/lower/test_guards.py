"""Guards in terms of ops: each is lowered once, and constants are constants."""

from __future__ import annotations

from colony.compile.guards import Always, And, ClientList, Guard, ModuleActive, Never, Not, Or
from colony.compile.lower.builder import CodeBuilder
from colony.compile.lower.memory import GuardLowering
from colony.execute.code import Apply, Kind, Literal, PythonActive
from colony.execute.operators import Operator


class Lowered:
    """Guards over modules whose activity comes from outside; `asked` are those that were asked for."""

    def __init__(self, *table: Guard) -> None:
        self.builder = CodeBuilder()
        self.asked: list[str] = []
        self.guards = GuardLowering(self.builder, ClientList(guards=table, actuators=()), self._active)

    def _active(self, module: str) -> int:
        self.asked.append(module)
        return self.builder.add(PythonActive(module), Kind.BOOL)


def test_constants() -> None:
    of = Lowered(Always(), Never())
    assert of.builder.ops[of.guards.guard(0)] == Literal(True)
    assert of.builder.ops[of.guards.guard(1)] == Literal(False)


def test_what_several_guards_are_made_of_is_lowered_once() -> None:
    of = Lowered(ModuleActive("a"), ModuleActive("b"), And((0, 1)), Not(2), Or((0, 3)))
    both, other = of.guards.guard(2), of.guards.guard(4)
    op = of.builder.ops[both]
    assert isinstance(op, Apply)
    assert op.operator is Operator.AND
    assert other != both
    assert of.asked == ["a", "b"]


def test_what_no_guard_asked_for_needs_is_not_lowered() -> None:
    of = Lowered(ModuleActive("a"), ModuleActive("b"), Not(1))
    of.guards.guard(2)
    assert of.asked == ["b"]
