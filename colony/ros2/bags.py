"""Bags of rosbag2, read by the package `rosbags` as if their messages arrived now. They are never changed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from colony.extras import expect_extras
from colony.ir.ros2_messages import AUTO, STANDARD, TWIST, TWIST_STAMPED
from colony.ros2.cdr import Definition, MessageError, structure
from colony.ros2.connection import NodeSettings
from colony.ros2.incoming import ArrivedMessage, Incoming, SimulatedClock
from colony.ros2.topics import HeardTopic

BEGIN_NS = 10_000_000_000
"""The time at which a bag begins here: what it has was measured up to a second before."""

DAY_NS, MAX_DAYS = 86_400_000_000_000, 7
"""Messages farther apart than these days are those of a recorder whose clock was set."""

CLOCK, CLOCK_TYPE = "/clock", "rosgraph_msgs/msg/Clock"
CLOCK_DEFINITION: Mapping[str, Definition] = {CLOCK_TYPE: (("clock", "builtin_interfaces/Time"),)}

_NAMES = {"bool": "boolean", "float32": "float", "float64": "double"}


NOT_READ = "not read, as its recorder was killed; open a copy of the bag with sqlite3 to include it"
"""The remark on the log of a SQLite file."""


class BagError(Exception):
    """A bag cannot be read; the message has the reason."""


class BagMessage(NamedTuple):
    """A message of a topic, which the recorder received at `t_ns`, in nanoseconds since the epoch."""

    topic: str
    t_ns: int
    data: bytes


class Bag:
    """A bag that is open: a folder with its metadata, or one file of it.

    Attributes:
        types: the types of each topic, that with the most messages first.
        remarks: what of it is not read.
        start_ns: time of the first message.
        end_ns: time of the last one.

    Raises:
        MissingExtraError: the package is not installed.
        BagError: the bag cannot be read.
    """

    def __init__(self, path: Path) -> None:
        expect_extras("bags")
        from rosbags.rosbag2 import Reader

        try:
            self._reader = Reader(path)
            self._reader.open()
        except Exception as problem:  # whatever the package and its storages raise
            raise _unreadable(problem) from None
        connections = sorted(self._reader.connections, key=lambda each: -each.msgcount)
        self.types: dict[str, tuple[str, ...]] = {}
        for each in connections:
            others = self.types.get(each.topic, ())
            self.types[each.topic] = (*others, each.msgtype) if each.msgtype not in others else others
        other = {str(getattr(each.ext, "serialization_format", "")) for each in connections} - {"cdr"}
        if other or not self._reader.message_count:
            self.close()
            why = f"its messages are {min(other)}; expected cdr" if other else "it has no messages"
            raise BagError(why)
        logs = (Path(f"{file}-wal") for file in ([path] if path.is_file() else sorted(path.iterdir())))
        self.remarks = tuple(
            f"{log.name}: {NOT_READ}" for log in logs if log.is_file() and log.stat().st_size
        )
        self.start_ns, self.end_ns = self._reader.start_time, self._reader.end_time - 1
        if (days := (self.end_ns - self.start_ns) / DAY_NS) > MAX_DAYS:
            self.close()
            raise BagError(f"{days:,.0f} days are between its first and last message: the clock was set")

    def __enter__(self) -> Bag:
        """Return the bag."""
        return self

    def __exit__(
        self, type_: type[BaseException] | None, raised: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the bag."""
        self.close()

    def close(self) -> None:
        """Close the bag."""
        self._reader.close()

    def definitions(self, type_: str) -> Mapping[str, Definition]:
        """Return the definition of a type, and of those it is made of, that are not standard.

        A bag without definitions has the usual ones.

        Raises:
            BagError: the definition in the bag is damaged.
        """
        from rosbags.typesys import Stores, get_typestore

        try:
            found = self._definitions(type_) or get_typestore(Stores.LATEST).fielddefs
        except Exception as problem:
            raise BagError(f"its definition of {type_} is damaged: {problem!s:.100}") from None
        return {
            name: tuple((field, _type(of)) for field, of in fields) for name, (_, fields) in found.items()
        }

    def _definitions(self, type_: str) -> dict[str, Any]:
        from rosbags.interfaces import MessageDefinitionFormat
        from rosbags.typesys import get_types_from_idl, get_types_from_msg

        defined = (each.msgdef for each in self._reader.connections if each.msgtype == type_)
        found: dict[str, Any] = {}
        for format_, text in defined:
            if format_ == MessageDefinitionFormat.MSG:
                found |= get_types_from_msg(text, type_)
            elif format_ == MessageDefinitionFormat.IDL:
                line, text = "=" * 80 + "\n", re.sub("(?m)^#.*$", "", text)
                parts = [part.partition("\n")[2] for part in text.split(line)[1:]]
                for part in parts if text.startswith(line) else [text]:
                    found |= get_types_from_idl(part)
        return found

    def messages(self, topics: Iterable[tuple[str, str]]) -> Iterator[BagMessage]:
        """Yield the messages of topics with these types, in the order of arrival.

        Raises:
            BagError: the rest of the bag cannot be read.
        """
        wanted = frozenset(topics)
        chosen = [each for each in self._reader.connections if (each.topic, each.msgtype) in wanted]
        try:
            for connection, t_ns, data in self._reader.messages(chosen) if chosen else ():
                yield BagMessage(connection.topic, t_ns, bytes(data))
        except Exception as problem:
            raise _unreadable(problem) from None


def _unreadable(problem: Exception) -> BagError:
    text = str(problem) or type(problem).__name__
    hint = "; `mcap recover` writes a copy of what is whole" if "end magic" in text else ""
    return BagError(f"{text.rstrip('.')}{hint}")


def _type(described: tuple[Any, Any]) -> str:
    """Return a type as rclpy writes it."""
    from rosbags.interfaces import Nodetype

    node, of = described
    match node:
        case Nodetype.BASE:
            name, bound = of
            return f"{_NAMES.get(name, name)}<{bound}>" if bound else _NAMES.get(name, name)
        case Nodetype.NAME:
            return str(of)
        case Nodetype.ARRAY:
            return f"{_type(of[0])}[{of[1]}]"
        case _:
            return f"sequence<{_type(of[0])}, {of[1]}>" if of[1] else f"sequence<{_type(of[0])}>"


# --- the bag as a connection ------------------------------------------------------------------------


class BagConnection:
    """The topics of a bag, heard as those of a running graph. Mutable: how far the bag was read.

    Times begin at `BEGIN_NS`. The time of ROS is that of /clock if the node uses it and the bag has it, or
    else the time at which the recorder received a message.

    Args:
        bag: the bag.
        node: the settings of the robot's node.
    """

    is_opening = False
    problem: str | None = None

    def __init__(self, bag: Bag, node: NodeSettings) -> None:
        self._bag, self._node = bag, node
        self._heard: dict[str, list[HeardTopic]] = {}
        self._types: dict[str, str] = {}
        self._definitions: dict[str, Definition] = {**STANDARD, **CLOCK_DEFINITION}
        self._now_ns = BEGIN_NS
        self._clock = SimulatedClock()
        self._times: Incoming | None = None
        self._messages: Iterator[BagMessage] | None = None
        self._next: BagMessage | None = None
        if node.use_sim_time and CLOCK_TYPE in bag.types.get(CLOCK, ()):
            self._times = Incoming(CLOCK, self.structure(CLOCK_TYPE))
            self._types[CLOCK] = CLOCK_TYPE

    def hear(self, topic: str, type_: str, *, quality: str = "best_effort", frame: str = "") -> HeardTopic:
        """Subscribe to a topic, unless the bag does not have it with this type."""
        name, expected = resolved(topic, self._node.name, self._node.namespace), types_of(type_)
        found = next((each for each in self._bag.types.get(name, ()) if each in expected), None)
        heard = HeardTopic(
            Incoming(name, None if found is None else self.structure(found), frame), type_, quality
        )
        if found is not None:
            self._heard.setdefault(name, []).append(heard)
            self._types[name] = found
        return heard

    def structure(self, type_: str) -> Any:
        """Return the structure of a message; None if the bag does not define it."""
        if type_ not in self._definitions:
            self._definitions = {**self._bag.definitions(type_), **self._definitions}
        try:
            return structure(type_, self._definitions)
        except MessageError:
            return None

    def now_ns(self) -> int:
        """Return the time of the bag."""
        return self._now_ns

    @property
    def is_paused(self) -> bool:
        """True if the clock of the simulation stands still."""
        return self._times is not None and self._clock.is_paused

    def advance(self, elapsed_ns: int) -> bool:
        """Let everything arrive that came up to this time of the bag; return False at its end.

        Raises:
            BagError: the rest of the bag cannot be read.
        """
        if self._messages is None:
            self._messages = self._bag.messages(self._types.items())
            self._next = next(self._messages, None)
        until_ns = self._bag.start_ns + elapsed_ns
        while (message := self._next) is not None and message.t_ns <= until_ns:
            self._arrive(message)
            self._next = next(self._messages, None)
        self._now_ns = BEGIN_NS + elapsed_ns
        if self._times is not None:
            self._clock.note(self._now_ns, self._ros_ns(until_ns))
        return until_ns <= self._bag.end_ns

    def _arrive(self, message: BagMessage) -> None:
        t_ns = BEGIN_NS + message.t_ns - self._bag.start_ns
        if message.topic == CLOCK and self._times is not None:
            self._times.put(ArrivedMessage(t_ns, 0, message.data))
            self._clock.note(t_ns, self._ros_ns(message.t_ns))
        arrived = ArrivedMessage(t_ns, self._ros_ns(message.t_ns), message.data)
        for heard in self._heard.get(message.topic, ()):
            heard.incoming.put(arrived)

    def _ros_ns(self, t_ns: int) -> int:
        """Return the time of ROS at a time of the recorder."""
        if self._times is None or (newest := self._times.message()) is None:
            return t_ns
        clock = newest.values["clock"]
        return int(clock["sec"]) * 1_000_000_000 + int(clock["nanosec"])

    def command(self, output: Any) -> Any:
        """Raise ConnectionError: a bag is not commanded."""
        raise ConnectionError("a bag is not commanded")

    def decide(self, output: Any, payload: bytes) -> None:
        """Raise ConnectionError: a bag is not commanded."""
        raise ConnectionError("a bag is not commanded")

    def stop(self, output: Any) -> None:
        """Do nothing: nothing moves."""

    def unreached(self, output: Any) -> str | None:
        """Return None: nothing has to stop."""
        return None

    def close(self) -> None:
        """Do nothing: its owner closes the bag."""


def types_of(type_: str) -> tuple[str, ...]:
    """Return the types that a topic may have, given the one that the body says."""
    return (TWIST, TWIST_STAMPED) if type_ == AUTO else (type_,)


def resolved(topic: str, node: str, namespace: str) -> str:
    """Return the full name of a topic that a node in a namespace names."""
    if topic.startswith("/"):
        return topic
    namespace = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
    if topic.startswith("~/"):
        return f"{namespace}/{node}/{topic[2:]}"
    return f"{namespace}/{topic}"
