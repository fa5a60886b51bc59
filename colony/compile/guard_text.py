"""Guards as text for people: short ones written out, long shared ones under names of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

from colony.compile.guards import Always, And, Guard, ModuleActive, Never, Not, Or, Recently

INLINE = 8
"""A part of a guard with more terms than this gets a name (`$1`, `$2`, ...) and is written out once."""

OWN = "P"
"""How a client's own activity is written in its guards: its applicability predicate (thesis Figure 4.11)."""


def duration_text(ns: int) -> str:
    """Nanoseconds as the language writes them: `1.5 s`, `250 ms`."""
    unit, scale, digits = ("s", 1_000_000_000, 9) if ns >= 1_000_000_000 else ("ms", 1_000_000, 6)
    whole, rest = divmod(ns, scale)
    fraction = f".{rest:0{digits}d}".rstrip("0").rstrip(".")
    return f"{whole}{fraction} {unit}"


class GuardText:
    """Writes guards of one table, and remembers which parts it named; total text is linear in the table."""

    def __init__(self, guards: Sequence[Guard]) -> None:
        self._guards = guards
        self._terms: list[int] = []  # of each guard as written in another one; 0 where it needs a name
        for guard in guards:
            terms = self._count(guard)
            self._terms.append(terms if terms <= INLINE else 0)
        self._names: dict[int, str] = {}
        self._named: list[tuple[int, str]] = []
        self._defined = 0

    def _count(self, guard: Guard) -> int:
        match guard:
            case Always() | Never() | ModuleActive():
                return 1
            case Not(operand=operand) | Recently(operand=operand):
                inner = self._guards[operand]
                return (self._terms[operand] or 1) + (not isinstance(inner, ModuleActive))
            case And(operands=parts) | Or(operands=parts):
                return sum(self._terms[part] or 1 for part in parts)
            case _:
                assert_never(guard)

    def text(self, ref: int, own: str | None = None) -> str:
        """The guard written out, with the module `own` as `P`, and first."""
        return self._written(ref, own, own)

    def take_definitions(self) -> list[tuple[str, str]]:
        """Names that were used since the last call, those used in their texts included, with their texts."""
        taken = []
        while self._defined < len(self._names):
            ref, name = self._named[self._defined]
            self._defined += 1
            taken.append((name, self._written(ref, None, None)))
        return taken

    def _written(self, ref: int, own: str | None, first: str | None) -> str:
        """Nesting is bounded by the number of terms: this recursion ends after `INLINE` levels."""
        guard = self._guards[ref]
        match guard:
            case Always():
                return "always"
            case Never():
                return "never"
            case ModuleActive(module=module):
                return OWN if module == own else module
            case Not(operand=operand):
                return f"not {self._part(operand, own, simple=True)}"
            case Recently(operand=operand, window_ns=window_ns):
                return f"recently({self._part(operand, own)}, {duration_text(window_ns)})"
            case And() | Or():
                kind, joint = (And, " and ") if isinstance(guard, And) else (Or, " or ")
                parts = sorted(self._flat(ref, kind), key=lambda part: self._rank(part, first))
                return joint.join(self._part(part, own, simple=True) for part in parts)
            case _:
                assert_never(guard)

    def _part(self, ref: int, own: str | None, simple: bool = False) -> str:
        if not self._terms[ref]:
            return self._name(ref)
        text = self._written(ref, own, None)
        return f"({text})" if simple and isinstance(self._guards[ref], And | Or) else text

    def _name(self, ref: int) -> str:
        name = self._names.get(ref)
        if name is None:
            name = self._names[ref] = f"${len(self._names) + 1}"
            self._named.append((ref, name))
        return name

    def _rank(self, ref: int, first: str | None) -> tuple[bool, int]:
        """Where a term stands: the module `first`, then all by the table, negations with what they negate."""
        guard = self._guards[ref]
        return guard != ModuleActive(first or ""), guard.operand if isinstance(guard, Not) else ref

    def _flat(self, ref: int, kind: type[And] | type[Or]) -> list[int]:
        """The operands of a conjunction (disjunction), with those of written-out ones among them in place."""
        flat: list[int] = []
        guard = self._guards[ref]
        assert isinstance(guard, And | Or)
        stack = list(reversed(guard.operands))
        while stack:
            part = stack.pop()
            inner = self._guards[part]
            if self._terms[part] and isinstance(inner, kind):
                stack.extend(reversed(inner.operands))
            else:
                flat.append(part)
        return list(dict.fromkeys(flat))
