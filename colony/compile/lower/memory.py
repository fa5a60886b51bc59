"""Memory functions in terms of cells.

Each takes the op numbers of its arguments and returns that of its value. Its memory is updated at the
end of frames in which `ready` is true (everything that its module or derived value reads is present).
Times need no value for "never": frame times begin at 0, so `until = 0` is past and `due = 0` has come.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import assert_never

from colony.compile import guards as g
from colony.compile.guards import ClientList
from colony.compile.lower.builder import CodeBuilder
from colony.execute.code import FrameTime, Kind, Literal
from colony.execute.operators import Operator
from colony.ir.expression import MemoryCall, MemoryFunction


@dataclass(frozen=True, slots=True, kw_only=True)
class MemorySite:
    """The name of one scalar memory call, and the condition `ready` for updating its memory.

    `cells` are the prefixes of its cells' names in `ir.memory`; a guard may belong to several time constants.
    """

    name: str
    cells: tuple[str, ...]
    ready: int

    def cell_names(self, part: str) -> tuple[str, ...]:
        """Return the names in `ir.memory` of the cell for one part of this memory."""
        return tuple([f"{cell} {part}" for cell in self.cells])


def remember(builder: CodeBuilder, call: MemoryCall, arguments: tuple[int, ...], site: MemorySite) -> int:
    """Return the value of one scalar memory call in this frame."""
    match call.function:
        case MemoryFunction.PREVIOUS:
            return _previous(builder, arguments[0], arguments[1], site)
        case MemoryFunction.CHANGED:
            old = _last(builder, arguments[0], site)
            return builder.both(started(builder, site), _differs(builder, arguments[0], old))
        case MemoryFunction.RISING:
            return builder.both(arguments[0], builder.negation(_last(builder, arguments[0], site)))
        case MemoryFunction.FALLING:
            return builder.both(builder.negation(arguments[0]), _last(builder, arguments[0], site))
        case MemoryFunction.RECENTLY:
            return until(builder, arguments[0], call.duration_ns, site)
        case MemoryFunction.SUSTAINED:
            return _sustained(builder, arguments[0], call.duration_ns, site)
        case MemoryFunction.ELAPSED:
            return _elapsed(builder, arguments[0], site)
        case MemoryFunction.LATCH:
            old = builder.cell(f"{site.name} value", Kind.BOOL, False, *site.cell_names("value"))
            value = builder.both(builder.either(old, arguments[0]), builder.negation(arguments[1]))
            builder.keep(old, site.ready, value)
            return value
        case MemoryFunction.CAPTURED:
            return _captured(builder, arguments[0], arguments[1], site)
        case MemoryFunction.EVERY:
            return _every(builder, call.duration_ns, site)
        case _:
            assert_never(call.function)


def started(builder: CodeBuilder, site: MemorySite) -> int:
    """Return the condition that `site` was ready before; sites with equal `ready` share a cell."""
    old = builder.cell(f"started {site.ready}", Kind.BOOL, False, *site.cell_names("started"))
    builder.keep(old, site.ready, builder.literal(True))
    return old


def until(builder: CodeBuilder, holds: int, window_ns: int, site: MemorySite) -> int:
    """Return the condition that `holds` is true, or was true less than `window_ns` ago."""
    now = builder.add(FrameTime(), Kind.TIME)
    end = builder.cell(f"{site.name} until", Kind.TIME, 0, *site.cell_names("until"))
    later = builder.apply(Operator.TIME_ADD, now, builder.time(window_ns))
    builder.keep(end, builder.both(site.ready, holds), later)
    return builder.either(holds, builder.apply(Operator.TIME_LESS, now, end))


def _last(builder: CodeBuilder, value: int, site: MemorySite) -> int:
    """Return the argument's value in the previous frame; false or 0 in the first one."""
    kind = builder.kinds[value]
    old = builder.cell(
        f"{site.name} last", kind, False if kind is Kind.BOOL else 0.0, *site.cell_names("last")
    )
    builder.keep(old, site.ready, value)
    return old


def _previous(builder: CodeBuilder, value: int, initial: int, site: MemorySite) -> int:
    constant = builder.ops[initial]
    if not isinstance(constant, Literal):
        return builder.apply(Operator.SELECT, started(builder, site), _last(builder, value, site), initial)
    old = builder.cell(f"{site.name} last", builder.kinds[value], constant.value, *site.cell_names("last"))
    builder.keep(old, site.ready, value)
    return old


def _differs(builder: CodeBuilder, value: int, old: int) -> int:
    return builder.apply(Operator.NOT_EQUAL, value, old)


def _elapsed(builder: CodeBuilder, holds: int, site: MemorySite) -> int:
    now = builder.add(FrameTime(), Kind.TIME)
    was = builder.cell(f"{site.name} was", Kind.BOOL, False, *site.cell_names("was"))
    since = builder.cell(f"{site.name} since", Kind.TIME, 0, *site.cell_names("since"))
    builder.keep(was, site.ready, holds)
    builder.keep(since, builder.both(site.ready, holds, builder.negation(was)), now)
    seconds = builder.apply(Operator.SECONDS, builder.apply(Operator.TIME_SUBTRACT, now, since))
    return builder.apply(Operator.SELECT, builder.both(holds, was), seconds, builder.literal(0.0))


def _sustained(builder: CodeBuilder, holds: int, duration_ns: int, site: MemorySite) -> int:
    """Return the condition that `holds` was true in every frame since one at least `duration_ns` ago.

    A frame that does not evaluate it counts as one in which it was false.
    """
    if duration_ns <= 0:
        return holds
    now = builder.add(FrameTime(), Kind.TIME)
    was = builder.cell(f"{site.name} was", Kind.BOOL, False, *site.cell_names("was"))
    due = builder.cell(f"{site.name} due", Kind.TIME, 0, *site.cell_names("due"))
    on = builder.both(site.ready, holds)
    builder.keep(was, builder.literal(True), on)
    later = builder.apply(Operator.TIME_ADD, now, builder.time(duration_ns))
    builder.keep(due, builder.both(on, builder.negation(was)), later)
    return builder.both(holds, was, builder.negation(builder.apply(Operator.TIME_LESS, now, due)))


def _captured(builder: CodeBuilder, value: int, key: int, site: MemorySite) -> int:
    kind, key_kind = builder.kinds[value], builder.kinds[key]
    held = builder.cell(
        f"{site.name} held", kind, False if kind is Kind.BOOL else 0.0, *site.cell_names("held")
    )
    last = builder.cell(
        f"{site.name} key", key_kind, False if key_kind is Kind.BOOL else 0.0, *site.cell_names("key")
    )
    key_changed = builder.either(
        builder.negation(started(builder, site)), builder.apply(Operator.NOT_EQUAL, key, last)
    )
    capture = builder.both(site.ready, key_changed)
    builder.keep(held, capture, value)
    builder.keep(last, capture, key)
    return builder.apply(Operator.SELECT, key_changed, value, held)


def _every(builder: CodeBuilder, interval_ns: int, site: MemorySite) -> int:
    now = builder.add(FrameTime(), Kind.TIME)
    due = builder.cell(f"{site.name} due", Kind.TIME, 0, *site.cell_names("due"))
    is_due = builder.negation(builder.apply(Operator.TIME_LESS, now, due))
    later = builder.apply(Operator.TIME_ADD, now, builder.time(interval_ns))
    builder.keep(due, builder.both(site.ready, is_due), later)
    return is_due


# --- guards -------------------------------------------------------------------------------------------
#
# Lowering of the guards of a client list to ops.


class GuardLowering:
    """Lowers the guards of a client list, each on first use.

    Args:
        builder: the builder that takes the ops.
        clients: the client list.
        active: a function from a module's name to the value of the module's activity.
        name: the prefix of the names of the guards' cells.
    """

    def __init__(
        self, builder: CodeBuilder, clients: ClientList, active: Callable[[str], int], name: str = "guard"
    ) -> None:
        self.builder = builder
        self.activity_guards = dict(clients.observed)  # by name of the wire or module
        self._name = name
        self._table = clients.guards
        self._active = active
        self._windows: defaultdict[int, tuple[str, ...]] = defaultdict(tuple)
        for cell, guard in clients.windows:
            self._windows[guard] += (cell,)
        self._values: dict[int, int] = {}

    def guard(self, root: int) -> int:
        """Return the value of a guard, lowered after all of its operands."""
        if root not in self._values:
            needed, pending = {root}, [root]
            while pending:
                for operand in g.operands(self._table[pending.pop()]):
                    if operand not in needed and operand not in self._values:
                        needed.add(operand)
                        pending.append(operand)
            for index in sorted(needed):
                self._values[index] = self._guard(index)
        return self._values[root]

    def _guard(self, index: int) -> int:
        node, values, builder = self._table[index], self._values, self.builder
        match node:
            case g.Always():
                return builder.literal(True)
            case g.Never():
                return builder.literal(False)
            case g.ModuleActive(module=module):
                return self._active(module)
            case g.Not(operand=operand):
                return builder.negation(values[operand])
            case g.And(operands=operands):
                return builder.both(*[values[i] for i in operands])
            case g.Or(operands=operands):
                return builder.either(*[values[i] for i in operands])
            case g.Recently(operand=operand, window_ns=window_ns):
                site = MemorySite(
                    name=f"{self._name} {index}", cells=self._windows[index], ready=builder.literal(True)
                )
                return until(builder, values[operand], window_ns, site)
            case _:
                assert_never(node)
