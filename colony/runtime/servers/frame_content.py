"""The content of DServer's frames: the variables that were requested by name, and no others.

The deployed program requests the variables that its sensors are bound to; connections use `publish`. So the
size of a frame depends on its readers, not on the number of variables.

A variable that the program reads is shown as NaN, a sensor fault, if frames cannot show its value, such as
a text.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import msgspec

from colony.ir.types import Value
from colony.runtime.frames.publishing import Fields
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.call_answers import ResourceLimit
from colony.runtime.store.store import Journal, Key

FRAME_SPACE = 1 << 16
"""Byte limit of the names and values in a frame that the program reads."""

PUBLISHED_SPACE = 1 << 15
"""Byte limit of the names and values in a frame that only connections requested."""

MAX_LIST_LENGTH = (FRAME_SPACE - 16) // 9
"""Length of the longest list of numbers that fits into a frame."""

MAX_NAMES_PER_CONNECTION = 1_000
"""Maximum number of names that one connection may request in frames."""

MAX_NAMES_REQUESTED = 10_000
"""Maximum number of names that all connections together may request in frames."""

_READS = Key("fact", "reads")


class FrameValue(NamedTuple):
    """A value as frames show it (None if they cannot), and its size in a frame in bytes.

    The size is 0 for a type that frames do not show.
    """

    value: Value | None
    size: int


NO_FRAME_VALUE = FrameValue(None, 0)
"""The frame value of nothing."""

FAULTY = FrameValue(math.nan, 0)
"""The frame value of anything but a number, a bool, or a list of these."""


_NOTHING = msgspec.msgpack.encode(None)


def frame_value(name: str, data: bytes) -> FrameValue:
    """Return the frame value of a variable's value in msgpack.

    A list that is too long for any frame is neither decoded nor checked; only its size is set.
    """
    length = _list_length(data)
    if length is not None and length > MAX_LIST_LENGTH:
        return FrameValue(None, _size(name, length))
    try:
        value = _numbers.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return NO_FRAME_VALUE if data == _NOTHING else FAULTY
    if isinstance(value, tuple):
        return FrameValue(value, _size(name, len(value))) if value else FAULTY
    return FrameValue(value, _size(name, 1))


class FrameContent:
    """The content of frames: the variables that they show, with their current values. Mutable.

    The variables that the program reads and those that only connections requested have separate limits, so
    that observers take no space from the program. A value that does not fit is left out.
    """

    def __init__(self, space: int = FRAME_SPACE) -> None:
        self.space = space
        self._program_limit = ResourceLimit("numbers in frames", space, in_bytes=True)
        self._published_limit = ResourceLimit(
            "numbers in frames that no program reads", PUBLISHED_SPACE, in_bytes=True
        )
        self._program_used = self._published_used = 0
        self._names: set[str] = set()
        self._program_names: frozenset[str] = frozenset()
        self._samples: dict[str, Sample] = {}
        self._sizes: dict[str, int] = {}
        self._fields: Fields | None = None

    @property
    def limit_messages(self) -> tuple[str, ...]:
        """User-readable messages about the limits reached since the server started."""
        return (
            *self._program_limit.limit_messages(self._program_used),
            *self._published_limit.limit_messages(self._published_used),
        )

    def set_program_names(self, names: Iterable[str]) -> frozenset[str]:
        """Set the variables that the program reads, in place of earlier ones.

        Return the names added and removed; the caller must `put` their current values again.
        """
        new = frozenset(names)
        changed = self._program_names ^ new
        for name in changed:
            self.drop(name)
        self._program_names = new
        return changed

    def fields(self) -> Fields:
        """Return the fields of a frame; frames share one object until something changes."""
        if self._fields is None:
            self._fields = self._samples.copy()
        return self._fields

    def growth(self, name: str, size: int) -> int:
        """Return the bytes by which a value of this size enlarges the program's share of frames."""
        return size - self._sizes.get(name, 0) if name in self._names and name in self._program_names else 0

    def check_published_space(self, size: int) -> None:
        """Check that frames have space for `size` more bytes that no program reads.

        Raises:
            RefusedError: "full".
        """
        if not self._published_limit.allows(self._published_used + size):
            text = (
                f"DServer's frames have no room for more than {PUBLISHED_SPACE} bytes that no program reads"
            )
            raise RefusedError("full", text)

    def check_space(self, growth: int) -> None:
        """Check that the program's share of frames has space for `growth` more bytes.

        Raises:
            RefusedError: "full".
        """
        if growth > 0 and not self._program_limit.allows(self._program_used + growth):
            text = f"DServer's frames have no room for more than {self._program_limit.limit} bytes of numbers"
            raise RefusedError("full", text)

    def show(self, name: str) -> None:
        """Show a variable from now on; the caller must `put` its current value."""
        self._names.add(name)

    def hide(self, name: str) -> None:
        """Stop showing a variable."""
        self._names.discard(name)
        self.drop(name)

    def put(self, name: str, shown: FrameValue, t_ns: int) -> None:
        """Show the new value of a variable, if frames show that variable and have space for the value."""
        if name not in self._names:
            return
        self.drop(name)
        if shown is FAULTY and name in self._program_names:
            shown = FAULTY._replace(size=_size(name, 1))
        if shown.size and self._allows(name, shown.size) and shown.value is not None:
            self._fields = None
            self._samples[name] = Sample(shown.value, t_ns)
            self._sizes[name] = shown.size
            self._add_used(name, shown.size)

    def drop(self, name: str) -> None:
        """Leave out a variable until `put` gives it a value."""
        if self._samples.pop(name, None) is not None:
            self._fields = None
            self._add_used(name, -self._sizes.pop(name))

    def _allows(self, name: str, size: int) -> bool:
        if name in self._program_names:
            return self._program_limit.allows(self._program_used + size)
        return self._published_limit.allows(self._published_used + size)

    def _add_used(self, name: str, size: int) -> None:
        if name in self._program_names:
            self._program_used += size
        else:
            self._published_used += size


class FrameSubscriptions:
    """The variables that the program and connections requested. Mutable.

    The names that the program reads are written to the journal. Most methods return the names that frames
    must show from now on, or no longer.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._run: str | None = None
        self._reads: tuple[str, ...] = ()
        self._program_is_running = False
        self._requested: dict[str, dict[str, None]] = {}  # by connection
        self._reader_counts: dict[str, int] = {}
        self._bound = ResourceLimit("names requested in frames", MAX_NAMES_REQUESTED)
        self._total = 0

    @property
    def limit_messages(self) -> tuple[str, ...]:
        """User-readable messages about the limits reached since the server started."""
        return self._bound.limit_messages(self._total)

    def deploy(self, run: str, reads: tuple[str, ...]) -> tuple[str, ...]:
        """Replace the program; return the names that no longer have a reader."""
        unread = self.begin_frame(None)[1]
        self._run, self._reads = run, tuple(dict.fromkeys(reads))
        self._journal.put(_READS, _encode((self._run, self._reads)))
        return unread

    def begin_frame(self, run: str | None) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Begin a frame of a run; return the names to show from now on, and those no longer to show.

        The program's names count only in frames of its own run.
        """
        is_running = run is not None and run == self._run
        if is_running == self._program_is_running:
            return (), ()
        self._program_is_running = is_running
        if is_running:
            return tuple(self._add(self._reads)), ()
        return (), tuple(self._remove(self._reads))

    @property
    def reads(self) -> tuple[str, ...]:
        """The variables that the program reads in the current frame."""
        return self._reads if self._program_is_running else ()

    def subscribe(self, connection: str, names: Iterable[str]) -> tuple[str, ...]:
        """Add names to those that a connection requests; return the names that had no reader before.

        Raises:
            RefusedError: "full".
        """
        requested = self._requested.get(connection, {})
        new = [name for name in dict.fromkeys(names) if name not in requested]
        if len(requested) + len(new) > MAX_NAMES_PER_CONNECTION:
            raise RefusedError(
                "full",
                f"DServer: a connection may request at most {MAX_NAMES_PER_CONNECTION} variables in frames",
            )
        if not self._bound.allows(self._total + len(new)):
            raise RefusedError(
                "full", f"DServer: connections request {MAX_NAMES_REQUESTED} variables in frames already"
            )
        self._requested.setdefault(connection, requested).update(dict.fromkeys(new))
        self._total += len(new)
        return tuple(self._add(new))

    def on_lost(self, connection: str) -> tuple[str, ...]:
        """Drop the names of a connection that ended; return the names that no longer have a reader."""
        names = self._requested.pop(connection, {})
        self._total -= len(names)
        return tuple(self._remove(names))

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the names that the program reads from the entries of a store."""
        if _READS in entries:
            self._run, self._reads = _reads.decode(entries[_READS])

    def _add(self, names: Iterable[str]) -> Iterator[str]:
        for name in names:
            self._reader_counts[name] = self._reader_counts.get(name, 0) + 1
            if self._reader_counts[name] == 1:
                yield name

    def _remove(self, names: Iterable[str]) -> Iterator[str]:
        for name in names:
            self._reader_counts[name] -= 1
            if not self._reader_counts[name]:
                del self._reader_counts[name]
                yield name


def _list_length(data: bytes) -> int | None:
    """Return the length of a list in msgpack, as its first bytes state it; None for any other value."""
    first = data[0] if data else 0
    if first & 0xF0 == 0x90:
        return first & 0x0F
    if first in (0xDC, 0xDD):
        return int.from_bytes(data[1 : 3 if first == 0xDC else 5], "big")
    return None


def _size(name: str, numbers: int) -> int:
    return len(name.encode()) + 9 * numbers + 16


_encode = msgspec.msgpack.Encoder().encode
_numbers = msgspec.msgpack.Decoder(float | bool | tuple[float | bool, ...])
_reads = msgspec.msgpack.Decoder(tuple[str, tuple[str, ...]])
