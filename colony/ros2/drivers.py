"""The drivers of servers over topics of ROS 2: of a base, and of devices with any fields and commands.

The numbers are in the units of ROS: m, rad, s, V, A. The server of a device converts those of its fields; the
driver of a base converts to mm and degrees. ROS has yaw 0 along x; a heading is 0 along y, north, so that
heading = yaw - 90 degrees. Places are the same.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any, Protocol

from colony.ir.ros2_messages import AXES, DEFAULT_PATHS, DRIVE_PATHS, LASER_SCAN, RANGE, TWISTS, is_action
from colony.ir.types import ScalarValue, Value
from colony.ros2.cdr import Structure, encode
from colony.ros2.connection import NodeSettings, Ros2Connection
from colony.ros2.heard import ParameterReader
from colony.ros2.incoming import Message, part
from colony.ros2.outgoing import ActionGoals, completed
from colony.ros2.scan import Mounting, ScanReader, UnusableError, distance
from colony.ros2.topics import CommandedAction, CommandedTopic, HeardTopic
from colony.runtime.servers.drivers import BaseState, OverheardCommand, Reading
from colony.runtime.transport.live.robot_address import RobotAddress

TIMEOUT_NS = 250_000_000
TIMEOUT_FRAMES = 3
"""Time without a decision after which the bridge stops, or number of frames if that is longer."""

DEFAULT_FRAME_NS = 50_000_000

STATUS = "status"
"""The path of the state of a goal, among those of the feedback on it."""

MM, DEG = 1000.0, 180.0 / math.pi

_TWIST = struct.Struct("<6d")


class TopicConnection(Protocol):
    """A connection to topics, as drivers use it: a bridge, or a bag."""

    @property
    def problem(self) -> str | None:
        """Why nothing arrives at all; None if something may."""
        ...

    @property
    def is_opening(self) -> bool:
        """True until the topics are known."""
        ...

    @property
    def is_paused(self) -> bool:
        """True if the clock of a simulation stands still."""
        ...

    def now_ns(self) -> int:
        """Return the time by the clock of arrivals."""
        ...

    def hear(self, topic: str, type_: str, *, quality: str = ..., frame: str = ...) -> HeardTopic:
        """Subscribe to a topic."""
        ...

    def structure(self, type_: str) -> Any:
        """Return the structure of a message; None while its definition is not known."""
        ...

    def command(self, output: CommandedTopic) -> CommandedTopic:
        """Command a topic, and return it."""
        ...

    def decide(self, output: CommandedTopic, payload: bytes) -> None:
        """Publish a command that was decided in this frame."""
        ...

    def stop(self, output: CommandedTopic) -> None:
        """Have the stop published."""
        ...

    def unreached(self, output: CommandedTopic) -> str | None:
        """Return why the last stop was not published, or not yet; None if it was."""
        ...

    def close(self) -> None:
        """End the connection with its last driver."""
        ...


class _Driver:
    """What the drivers of a robot have in common: one connection, and its problems. Mutable.

    One that listens publishes nothing. It hears what another controller commands in place of that.
    """

    def __init__(
        self,
        node: str,
        frame_ns: int,
        connection: TopicConnection | None,
        robot_address: RobotAddress | None,
        *,
        listen: bool,
    ) -> None:
        settings = NodeSettings(**json.loads(node))
        seen = None if listen else robot_address  # one that only listens offers nothing to other nodes
        self._connection: TopicConnection = connection or Ros2Connection.shared(settings, robot=seen)
        self._frame_ns, self._listens = frame_ns, listen
        self._inputs: dict[str, HeardTopic] = {}
        self._outputs: dict[str, CommandedTopic] = {}
        self._overheard: dict[str, tuple[HeardTopic, ParameterReader, int | None]] = {}

    def _hear(self, name: str, topic: Mapping[str, Any]) -> HeardTopic:
        """Subscribe to the topic of a field."""
        found = self._connection.hear(
            topic["topic"],
            topic["type"],
            quality=topic.get("qos") or "best_effort",
            frame=topic.get("frame", ""),
        )
        self._inputs[name] = found
        return found

    def _timeout_ns(self, topic: Mapping[str, Any]) -> int:
        """Return the time without a decision after which the bridge stops a command."""
        return topic.get("timeout_ns") or max(TIMEOUT_NS, TIMEOUT_FRAMES * self._frame_ns)

    def _command(self, name: str, topic: Mapping[str, Any]) -> None:
        """Command the topic of a command, or listen to it."""
        timeout_ns = self._timeout_ns(topic)
        is_stopped = topic.get("stop", "zero" if topic["type"] in TWISTS else "keep") == "zero"
        if self._listens:
            quality = "latched" if topic.get("qos") == "latched" else "best_effort"
            heard = self._connection.hear(topic["topic"], topic["type"], quality=quality)
            self._overheard[name] = heard, ParameterReader(topic), timeout_ns if is_stopped else None
            return
        found = CommandedTopic(
            topic["topic"],
            topic["type"],
            timeout_ns=timeout_ns,
            is_stopped=is_stopped,
            quality=topic.get("qos") or "reliable",
            alone=topic.get("alone", False),
            frame=topic.get("frame", ""),
        )
        self._outputs[name] = self._connection.command(found)

    @property
    def problem(self) -> str | None:
        """What is wrong with the bridge, or with the topics of this server; None if all works."""
        if (why := self._connection.problem) is not None:
            return why
        heard = [heard for heard, _, _ in self._overheard.values()]
        ends: list[HeardTopic | CommandedTopic] = [*self._inputs.values(), *self._outputs.values(), *heard]
        return "; ".join(dict.fromkeys(why for end in ends if (why := end.problem) is not None)) or None

    @property
    def is_opening(self) -> bool:
        """True until the graph is known, unless something failed."""
        return self._connection.is_opening

    @property
    def unreached(self) -> str | None:
        """Why the last stop was not published, or not yet; None if it was."""
        return next(filter(None, map(self._connection.unreached, self._outputs.values())), None)

    def _message(self, name: str) -> Message | None:
        """Return the newest message of a topic; None if there is none, or the clock stands still."""
        return None if self._connection.is_paused else self._inputs[name].incoming.message()

    def overheard(self) -> Mapping[str, OverheardCommand | None]:
        """Return what another controller commands, in the units of commands.

        A command that has a stop is none any more after its timeout.
        """
        return {name: self._overhear(*each) for name, each in self._overheard.items()}

    def _overhear(
        self, heard: HeardTopic, reader: ParameterReader, timeout_ns: int | None
    ) -> OverheardCommand | None:
        message = None if self._connection.is_paused else heard.incoming.message()
        if message is None:
            return None
        age_ns = self._connection.now_ns() - message.t_ns
        if timeout_ns is not None and age_ns > timeout_ns:
            return None
        try:
            return OverheardCommand(self._overheard_values(reader.read(message.values)), max(0, age_ns))
        except UnusableError as problem:
            heard.incoming.refuse(problem)
            return None

    def _overheard_values(self, values: Mapping[str, ScalarValue]) -> Mapping[str, ScalarValue]:
        """Return the parameters of a command in the units in which the driver takes them."""
        return values

    def _stop(self) -> None:
        for output in self._outputs.values():
            self._connection.stop(output)

    def close(self) -> None:
        """Leave the bridge, which stops what was commanded."""
        self._connection.close()


# --- the base -------------------------------------------------------------------------------------


class Ros2Base(_Driver):
    """The driver of a base, for `RServer`: odometry, and a twist.

    Args:
        node: the settings of the node, JSON.
        topics: the topics by field (`odom`, bumpers) and command (`drive`), JSON.
        frame_ns: the length of the robot's frames.
        listen: True to command nothing, and to hear what another controller commands.
        connection: what it is heard and commanded over; by default that of the node.
        robot_address: the robot that other nodes see; None for none.
    """

    register_bits: int | None = None

    def __init__(
        self,
        node: str,
        topics: str,
        *,
        frame_ns: int = DEFAULT_FRAME_NS,
        listen: bool = False,
        connection: TopicConnection | None = None,
        robot_address: RobotAddress | None = None,
    ) -> None:
        super().__init__(node, frame_ns, connection, robot_address, listen=listen)
        given = json.loads(topics)
        for name, topic in given["in"].items():
            self._hear(name, topic)
        self._paths = {name: topic.get("path") or "data" for name, topic in given["in"].items()}
        for name, topic in given["out"].items():
            self._command(name, topic)
        self._from: tuple[Message | None, ...] = ()
        self._state: BaseState | None = None
        self._rests = False

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> None:
        """Drive at `velocity` mm/s ahead, `turn` deg/s counterclockwise and `sideways` mm/s to the left.

        Raises:
            ConnectionError: the bridge does not run, or the topic is not commanded.
        """
        if (output := self._outputs.get("drive")) is None:
            raise ConnectionError("the body names no topic `ros2.drive`")
        self._rests = False
        payload = _TWIST.pack(velocity / MM, sideways / MM, 0.0, 0.0, 0.0, turn / DEG)
        self._connection.decide(output, payload)

    def _overheard_values(self, values: Mapping[str, ScalarValue]) -> Mapping[str, ScalarValue]:
        return {name: value * (DEG if name == "turn" else MM) for name, value in values.items()}

    def stop(self) -> None:
        """Stop. Never raises."""
        self._rests = True
        self._stop()

    def rest(self) -> None:
        """Stop once, and then publish nothing until the next command, so that other nodes may drive."""
        if not self._rests:
            self.stop()

    def state(self) -> BaseState | None:
        """Return the newest state, the same object until the next message; None without one."""
        messages = tuple(map(self._message, self._inputs))
        if any(new is not old for new, old in zip(messages, self._from, strict=False)) or not self._from:
            self._from, self._state = messages, None
            found = dict(zip(self._inputs, messages, strict=True))
            if "odom" in found and None not in messages:
                try:
                    self._state = self._read({name: m for name, m in found.items() if m is not None})
                except UnusableError as problem:
                    self._inputs["odom"].incoming.refuse(problem)
        return self._state

    def _read(self, found: Mapping[str, Message]) -> BaseState:
        values = found["odom"].values
        place, speed = part(values, "pose.pose.position"), part(values, "twist.twist.linear")
        turn = part(values, "twist.twist.angular.z")
        numbers = (place["x"], place["y"], speed["x"], speed["y"], turn)
        if not all(map(math.isfinite, numbers)):
            raise UnusableError("a number of the odometry is not finite")
        touches = {n: bool(part(m.values, self._paths[n])) for n, m in found.items() if n != "odom"}
        both = touches.get("bumper", False)
        return BaseState(
            t_ns=min(message.t_ns for message in found.values()),
            x=place["x"] * MM,
            y=place["y"] * MM,
            heading=part(values, "pose.pose.orientation.heading") * DEG % 360.0,
            front_bumper=touches.get("front_bumper", False) or both,
            rear_bumper=touches.get("rear_bumper", False) or both,
            speed=speed["x"] * MM,
            turn_rate=turn * DEG,
            wheel_speed=math.hypot(speed["x"], speed["y"]) * MM,
            sideways_speed=speed["y"] * MM,
        )


# --- other devices --------------------------------------------------------------------------------


class Ros2Device(_Driver):
    """The driver of a server with fields and commands of topics; arguments as above."""

    def __init__(
        self,
        node: str,
        topics: str,
        *,
        frame_ns: int = DEFAULT_FRAME_NS,
        listen: bool = False,
        connection: TopicConnection | None = None,
        robot_address: RobotAddress | None = None,
    ) -> None:
        super().__init__(node, frame_ns, connection, robot_address, listen=listen)
        given = json.loads(topics)
        self._commands = {name: _Command(topic) for name, topic in given["out"].items()}
        self._goals: dict[str, ActionGoals] = {}
        for name, topic in given["out"].items():
            if not is_action(topic["type"]):
                self._command(name, topic)
            elif not self._listens:  # the client of an action cancels goals
                self._goals[name] = self._join(name, topic)
        self._readers = {name: self._reader(name, topic) for name, topic in given["in"].items()}
        self.commands: Set[str] = self._commands.keys()

    def _join(self, name: str, topic: Mapping[str, Any]) -> ActionGoals:
        """Command an action, and hear the feedback on its goals."""
        action, type_, timeout_ns = topic["topic"], topic["type"], self._timeout_ns(topic)
        feedback = self._hear(name, {"topic": action, "type": f"{type_}_Feedback"})
        output = CommandedAction(action, type_, timeout_ns=timeout_ns, feedback=feedback)
        self._outputs[name] = self._connection.command(output)
        return ActionGoals(output, timeout_ns)

    def _reader(self, name: str, topic: Mapping[str, Any]) -> Callable[[], Reading | None]:
        """Return the function that reads a field."""
        if not is_action(topic["type"]):
            field = _Field(topic, self._hear(name, topic))
            return lambda: field.read(self._message(name), self._connection.now_ns())
        if self._listens:
            return lambda: None
        goals = next(goals for goals in self._goals.values() if goals.output.topic == topic["topic"])
        part_of_action = _Field(topic, goals.output.feedback)
        if topic["path"] == STATUS:
            return lambda: part_of_action.read_state(goals.state)
        return lambda: part_of_action.read(
            None if self._connection.is_paused else goals.feedback(), self._connection.now_ns()
        )

    def fields(self) -> Mapping[str, Reading | None]:
        """Return the newest reading of each field, in the units of ROS."""
        return {name: read() for name, read in self._readers.items()}

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Publish a command that was decided in this frame.

        Raises:
            ConnectionError: the bridge does not run, or the topic is not commanded.
            ValueError: the message cannot have these values.
        """
        command, output = self._commands[name], self._outputs[name]
        if command.kind is None and not command.is_twist:
            command.kind = self._connection.structure(command.type)
        payload = command.payload(values)
        goals = self._goals.get(name)
        self._connection.decide(output, payload if goals is None else goals.payload(payload))

    def safe(self) -> None:
        """Stop what has a stop, and cancel the goals of actions. Never raises."""
        for goals in self._goals.values():
            goals.clear()
        self._stop()


class _Field:
    """A field that a topic has. Mutable: its value of the newest message."""

    def __init__(self, topic: Mapping[str, Any], found: HeardTopic) -> None:
        self._incoming, self._type = found.incoming, topic["type"]
        self._path: str = topic.get("path") or DEFAULT_PATHS.get(self._type, "data")
        self._members: Mapping[str, float] | None = topic.get("members")
        self._is_bool: bool = topic.get("bool", False)
        self._is_zero_no_echo: bool = topic.get("zero") == "no_echo"
        self._scan: ScanReader | None = None
        if self._type == LASER_SCAN and self._path == "ranges":
            mounting = Mounting(
                bearing_rad=math.radians(topic.get("mounted_deg", 0.0)),
                is_upside_down=topic.get("upside_down", False),
                is_zero_no_echo=self._is_zero_no_echo,
            )
            bearings = [math.radians(bearing) for bearing in topic["bearings_deg"]]
            self._scan = ScanReader(bearings, math.radians(topic["spacing_deg"]), mounting)
        self._from: Message | None = None
        self._value: Any = None

    def read(self, message: Message | None, now_ns: int) -> Reading | None:
        """Return the reading of the newest message at `now_ns`."""
        if message is not self._from:
            self._from, self._value = message, None
            if message is not None:
                try:
                    self._value = self._read(message.values)
                except UnusableError as problem:
                    self._incoming.refuse(problem)
        if message is None or self._value is None:
            return None
        return Reading(self._value, max(0, now_ns - message.t_ns))

    def read_state(self, state: str | None) -> Reading | None:
        """Return the reading of the state of a goal."""
        try:
            return None if state is None else Reading(self._scalar(state) or 0.0, 0)
        except UnusableError as problem:
            self._incoming.refuse(problem)
            return None

    def _read(self, values: Mapping[str, Any]) -> Value | tuple[ScalarValue | None, ...] | None:
        if self._scan is not None:
            return self._scan.read(values)
        found = part(values, self._path)
        if self._type == RANGE and self._path == "range":
            low, high = values["min_range"], values["max_range"]
            return distance(found, low, high, is_zero_no_echo=self._is_zero_no_echo)
        if isinstance(found, Sequence) and not isinstance(found, str):
            return tuple([self._scalar(each) for each in found])
        return self._scalar(found)

    def _scalar(self, found: Any) -> ScalarValue | None:
        """Return a value of a message as one of the language; None if it is NaN."""
        if isinstance(found, str):
            if self._members is None or found not in self._members:
                raise UnusableError(f'"{found[:40]}" is no member of the enum')
            return self._members[found]
        if found is None or isinstance(found, Mapping):
            if found is None:
                return None
            raise UnusableError(f"`{self._path}` is a message; name one of its fields")
        if self._is_bool:
            return bool(found)
        return None if found != found else float(found)


class _Command:
    """A command that a topic takes. Mutable: learns the definition of its message, whose type is `type`."""

    def __init__(self, topic: Mapping[str, Any]) -> None:
        self.type: str = topic["type"] + ("_Goal" if is_action(topic["type"]) else "")
        self.kind: Structure | None = None
        self._frame: str = topic.get("frame", "")
        self._parameters: Mapping[str, str] = topic.get("parameters") or {}
        self._texts = {number: name for name, number in (topic.get("members") or {}).items()}
        self.is_twist = self.type in TWISTS

    def payload(self, values: Mapping[str, ScalarValue]) -> bytes:
        """Return the payload of a command.

        Raises:
            ValueError: the message cannot have these values.
        """
        if self.is_twist:
            axes = {self._parameters.get(name, DRIVE_PATHS.get(name, name)): v for name, v in values.items()}
            if unknown := axes.keys() - set(AXES):
                raise ValueError(f"a twist has no `{min(unknown)}`")
            return _TWIST.pack(*[float(axes.get(axis, 0.0)) for axis in AXES])
        if self.kind is None:
            raise ConnectionError(f"the definition of `{self.type}` is not known yet")
        parts: dict[str, ScalarValue | str] = {}
        for name, value in values.items():
            path = self._parameters.get(name) or ("data" if len(values) == 1 else name)
            parts[path] = self._texts.get(float(value), "") if self._texts else value
        return encode(self.kind, completed(self.kind, parts, self._frame))
