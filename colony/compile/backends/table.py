"""The compiled form as a table: what `colony compile` prints."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap
from typing import assert_never

from colony.compile.guards import ActuatorClients, Always, And, Guard, ModuleActive, Never, Not, Or, Recently
from colony.compile.pipeline import Compilation
from colony.text.wording import duration_text

# --- guard text ---------------------------------------------------------------------------------------
#
# Guards as readable text: short parts inline, long parts under names of their own.

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


# --- table --------------------------------------------------------------------------------------------

GUARD_WIDTH = 48
"""Maximum width of a line of a guard, in characters."""

_HEADER = ("priority", "module", "guard", "exclusive guard")
_GAP = "  "


def client_table(compilation: Compilation) -> str:
    """Return the clients of each actuator, highest priority first, with both guards; then the named parts.

    The text has no line break at its end. Its size is linear in the clients and their guards.
    """
    guards = GuardText(compilation.clients.guards)
    blocks = [f"{actuator.actuator}\n{rows(actuator, guards)}" for actuator in compilation.clients.actuators]
    driven = {actuator.actuator for actuator in compilation.clients.actuators}
    idle = [a.name for a in compilation.program.robot.actuators if a.name not in driven]
    blocks += [f"{name}\n{_GAP}nothing drives it" for name in idle]
    if compilation.clients.actuators:
        blocks.append("\n".join((legend(guards), *_failsafe_line(compilation))))
    return "\n\n".join(blocks)


def _failsafe_line(compilation: Compilation) -> tuple[str, ...]:
    """Return a line on the failsafe modules, if there are any."""
    names = ", ".join(compilation.network.failsafe_modules)
    return (f"Failsafe, active also where something that they read is missing: {names}",) if names else ()


def rows(actuator: ActuatorClients, guards: GuardText, limit: int | None = None) -> str:
    """Return the table of one actuator, with at most `limit` clients."""
    shown = actuator.clients[:limit]
    cells: list[tuple[list[str], ...]] = [tuple([name] for name in _HEADER)]
    for client in shown:
        texts = (guards.text(ref, client.module) for ref in (client.guard, client.exclusive))
        cells.append(([str(client.priority)], [client.module], *(wrapped(text) for text in texts)))
    text = _aligned(cells)
    left_out = len(actuator.clients) - len(shown)
    return f"{text}\n{_GAP}({left_out} more clients left out)" if left_out else text


def legend(guards: GuardText, limit: int | None = None) -> str:
    """Return the meaning of `P`, and at most `limit` definitions of guard parts named since the last call."""
    lines = [f"{OWN}: the client's own activity. Both guards give the same winner."]
    return "\n".join(lines + definitions(guards, limit))


def definitions(guards: GuardText, limit: int | None = None) -> list[str]:
    """Return the definitions of the parts of guards named since the last call, as lines."""
    lines = []
    taken = guards.take_definitions(limit)
    for name, text in taken:
        first, *continuation = wrapped(text, 2 * GUARD_WIDTH)
        lines.append(f"{name} = {first}")
        lines += [f"{'':{len(name)}}   {line}" for line in continuation]
    if len(taken) == limit:
        lines.append("(more parts of guards left out)")
    return lines


def wrapped(text: str, width: int = GUARD_WIDTH) -> list[str]:
    """Return the text in lines of this width, without breaking words."""
    return wrap(text, width, break_long_words=False)


def _aligned(cells: Sequence[Sequence[list[str]]]) -> str:
    """Return aligned columns, the first right-aligned; a cell is a list of lines."""
    widths = [max(len(line) for row in cells for line in row[i]) for i in range(len(_HEADER))]
    lines = []
    for row in cells:
        for i in range(max(map(len, row))):
            texts = [cell[i] if i < len(cell) else "" for cell in row]
            padded = [texts[0].rjust(widths[0])]
            padded += [text.ljust(width) for text, width in zip(texts[1:], widths[1:], strict=True)]
            lines.append((_GAP + _GAP.join(padded)).rstrip())
    return "\n".join(lines)
