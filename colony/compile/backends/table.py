"""The compiled form as a table: what `colony compile` prints."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap

from colony.compile.backends.guard_text import OWN, GuardText
from colony.compile.clients import ActuatorClients
from colony.compile.pipeline import Compilation

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
