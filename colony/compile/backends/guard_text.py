"""Guards as readable text: short parts inline, long parts under names of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

from colony.compile.guards import Always, And, Guard, ModuleActive, Never, Not, Or, Recently
from colony.text.wording import duration_text

INLINE = 8
"""Maximum number of terms of an inline part; longer ones get names (`$1`, `$2`, ...) and are written once."""

OWN = "P"
"""Symbol of a client's own activity in its guards: its applicability predicate (thesis Figure 4.11)."""


class GuardText:
    """Prints the guards of one table, and names long parts, so that the text is linear in the table."""

    def __init__(self, guards: Sequence[Guard]) -> None:
        self._guards = guards
        self._terms: list[int] = []  # by guard: number of terms if inline, 0 if it needs a name
        for guard in guards:
            terms = self._count_terms(guard)
            self._terms.append(terms if terms <= INLINE else 0)
        self._names: dict[int, str] = {}
        self._named: list[tuple[int, str]] = []
        self._defined = 0

    def _count_terms(self, guard: Guard) -> int:
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
        """Return the text of a guard; the module `own` is written as `P` and comes first."""
        return self._write(ref, own)

    def take_definitions(self, limit: int | None = None) -> list[tuple[str, str]]:
        """Return the names used since the last call, directly or in other definitions, with their texts.

        Return at most `limit` of them; the others are left for the next call.
        """
        taken: list[tuple[str, str]] = []
        while self._defined < len(self._named) and len(taken) != limit:
            ref, name = self._named[self._defined]
            self._defined += 1
            taken.append((name, self._write(ref, None)))
        return taken

    def _write(self, ref: int, own: str | None) -> str:
        """Return the text of a guard. The recursion is at most `INLINE` levels deep."""
        joined = self._decompose(ref)
        if joined is not None:
            connective, parts, negated = joined
            parts.sort(key=lambda part: self._rank(part, own))
            return connective.join(
                self._write_negated(p, own) if negated else self._write_operand(p, own) for p in parts
            )
        guard = self._guards[ref]
        match guard:
            case Always():
                return "always"
            case Never():
                return "never"
            case ModuleActive(module=module):
                return OWN if module == own else module
            case Not(operand=operand):
                return f"not {self._write_operand(operand, own)}"
            case Recently(operand=operand, window_ns=window_ns):
                inner = self._write(operand, own) if self._terms[operand] else self._name(operand)
                return f"recently({inner}, {duration_text(window_ns)})"
            case And() | Or():
                raise AssertionError("joined")
            case _:
                assert_never(guard)

    def _write_operand(self, ref: int, own: str | None) -> str:
        """Return a guard as an operand: its name, or its text, in parentheses if it has a connective."""
        if not self._terms[ref]:
            return self._name(ref)
        text = self._write(ref, own)
        return text if self._decompose(ref) is None else f"({text})"

    def _write_negated(self, ref: int, own: str | None) -> str:
        guard = self._guards[ref]
        return (
            self._write_operand(guard.operand, own)
            if isinstance(guard, Not)
            else f"not {self._write_operand(ref, own)}"
        )

    def _name(self, ref: int) -> str:
        name = self._names.get(ref)
        if name is None:
            name = self._names[ref] = f"${len(self._names) + 1}"
            self._named.append((ref, name))
        return name

    def _decompose(self, ref: int) -> tuple[str, list[int], bool] | None:
        """Return (connective, parts, True if the parts are negated), or None if there is no connective.

        `not (not a and not b)` is written `a or b`: De Morgan's law is applied if most parts are negated.
        """
        guard = self._guards[ref]
        match guard:
            case And():
                return " and ", self._flatten(guard), False
            case Or():
                return " or ", self._flatten(guard), False
            case Not(operand=operand):
                inner = self._guards[operand]
                if not isinstance(inner, And | Or) or not self._terms[operand]:
                    return None
                parts = self._flatten(inner)
                if 2 * sum(isinstance(self._guards[part], Not) for part in parts) <= len(parts):
                    return None
                return " or " if isinstance(inner, And) else " and ", parts, True
            case _:
                return None

    def _flatten(self, guard: And | Or) -> list[int]:
        """Return the operands, with inline operands of the same kind replaced by their own operands."""
        flat: list[int] = []
        stack = list(reversed(guard.operands))
        while stack:
            part = stack.pop()
            inner = self._guards[part]
            if self._terms[part] and isinstance(inner, And | Or) and type(inner) is type(guard):
                stack.extend(reversed(inner.operands))
            else:
                flat.append(part)
        return list(dict.fromkeys(flat))

    def _rank(self, ref: int, own: str | None) -> tuple[bool, int]:
        """Return the sort key of a part: the module `own` first, then in table order, `not a` beside `a`."""
        guard = self._guards[ref]
        return guard != ModuleActive(own or ""), guard.operand if isinstance(guard, Not) else ref
