"""Memory functions in terms of cells.

Each takes the number of its arguments in this frame and gives the number of its value; what it remembers
moves on at the end of frames in which `ready` is true (all that its module or derived value reads is there).
Times stay comparable without a value for "never": frame times begin at 0, so `until = 0` is past and
`due = 0` has come.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from colony.compile.lower.builder import Builder
from colony.execute.code import FrameTime, Kind, Literal
from colony.execute.operators import Operator
from colony.ir.expression import Memory, MemoryCall


@dataclass(frozen=True, slots=True, kw_only=True)
class MemorySite:
    """The name of one scalar memory call, and the value that says in which frames it moves on.

    `cells` are what the names of its cells begin with in `ir.memory`; a guard may stand in several places.
    """

    name: str
    cells: tuple[str, ...]
    ready: int

    def called(self, part: str) -> tuple[str, ...]:
        """Return the names that `ir.memory` gives a part of this memory."""
        return tuple([f"{cell} {part}" for cell in self.cells])


def remember(builder: Builder, call: MemoryCall, arguments: tuple[int, ...], place: MemorySite) -> int:
    """Return the value of one scalar memory function in this frame."""
    match call.function:
        case Memory.PREVIOUS:
            return _previous(builder, arguments[0], arguments[1], place)
        case Memory.CHANGED:
            old = _last(builder, arguments[0], place)
            return builder.both(started(builder, place), _differs(builder, arguments[0], old))
        case Memory.RISING:
            return builder.both(arguments[0], builder.negation(_last(builder, arguments[0], place)))
        case Memory.FALLING:
            return builder.both(builder.negation(arguments[0]), _last(builder, arguments[0], place))
        case Memory.HELD:
            return until(builder, arguments[0], call.duration_ns, place)
        case Memory.ELAPSED:
            return _elapsed(builder, arguments[0], place)
        case Memory.LATCH:
            old = builder.cell(f"{place.name} value", Kind.BOOL, False, *place.called("value"))
            value = builder.both(builder.either(old, arguments[0]), builder.negation(arguments[1]))
            builder.keep(old, place.ready, value)
            return value
        case Memory.CAPTURED:
            return _captured(builder, arguments[0], arguments[1], place)
        case Memory.EVERY:
            return _every(builder, call.duration_ns, place)
        case _:
            assert_never(call.function)


def started(builder: Builder, place: MemorySite) -> int:
    """Return the condition that an earlier frame had `place` ready; each condition has one cell."""
    old = builder.cell(f"started {place.ready}", Kind.BOOL, False, *place.called("started"))
    builder.keep(old, place.ready, builder.literal(True))
    return old


def until(builder: Builder, holds: int, window_ns: int, place: MemorySite) -> int:
    """Return a condition true from a frame with `holds` until `window_ns` after the last one, exclusive."""
    now = builder.add(FrameTime(), Kind.TIME)
    end = builder.cell(f"{place.name} until", Kind.TIME, 0, *place.called("until"))
    later = builder.apply(Operator.TIME_ADD, now, builder.time(window_ns))
    builder.keep(end, builder.both(place.ready, holds), later)
    return builder.either(holds, builder.apply(Operator.TIME_LESS, now, end))


def _last(builder: Builder, value: int, place: MemorySite) -> int:
    """Return the argument in the last frame; false or 0 at first."""
    kind = builder.kinds[value]
    old = builder.cell(f"{place.name} last", kind, False if kind is Kind.BOOL else 0.0, *place.called("last"))
    builder.keep(old, place.ready, value)
    return old


def _previous(builder: Builder, value: int, initial: int, place: MemorySite) -> int:
    constant = builder.ops[initial]
    if not isinstance(constant, Literal):
        return builder.apply(Operator.SELECT, started(builder, place), _last(builder, value, place), initial)
    old = builder.cell(f"{place.name} last", builder.kinds[value], constant.value, *place.called("last"))
    builder.keep(old, place.ready, value)
    return old


def _differs(builder: Builder, value: int, old: int) -> int:
    return builder.apply(Operator.NOT_EQUAL, value, old)


def _elapsed(builder: Builder, holds: int, place: MemorySite) -> int:
    now = builder.add(FrameTime(), Kind.TIME)
    was = builder.cell(f"{place.name} was", Kind.BOOL, False, *place.called("was"))
    since = builder.cell(f"{place.name} since", Kind.TIME, 0, *place.called("since"))
    builder.keep(was, place.ready, holds)
    builder.keep(since, builder.both(place.ready, holds, builder.negation(was)), now)
    seconds = builder.apply(Operator.SECONDS, builder.apply(Operator.TIME_SUBTRACT, now, since))
    return builder.apply(Operator.SELECT, builder.both(holds, was), seconds, builder.literal(0.0))


def _captured(builder: Builder, value: int, key: int, place: MemorySite) -> int:
    kind, key_kind = builder.kinds[value], builder.kinds[key]
    held = builder.cell(
        f"{place.name} held", kind, False if kind is Kind.BOOL else 0.0, *place.called("held")
    )
    last = builder.cell(
        f"{place.name} key", key_kind, False if key_kind is Kind.BOOL else 0.0, *place.called("key")
    )
    new = builder.either(
        builder.negation(started(builder, place)), builder.apply(Operator.NOT_EQUAL, key, last)
    )
    take = builder.both(place.ready, new)
    builder.keep(held, take, value)
    builder.keep(last, take, key)
    return builder.apply(Operator.SELECT, new, value, held)


def _every(builder: Builder, interval_ns: int, place: MemorySite) -> int:
    now = builder.add(FrameTime(), Kind.TIME)
    due = builder.cell(f"{place.name} due", Kind.TIME, 0, *place.called("due"))
    is_due = builder.negation(builder.apply(Operator.TIME_LESS, now, due))
    later = builder.apply(Operator.TIME_ADD, now, builder.time(interval_ns))
    builder.keep(due, builder.both(place.ready, is_due), later)
    return is_due
