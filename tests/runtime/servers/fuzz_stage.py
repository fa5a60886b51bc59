"""Servers on a stage where anybody throws anything at them, as bytes, the way a host hands it on.

The stage holds every server to what is promised to callers: nothing that comes makes it fail; who makes a
call with a new number is answered, at once unless the method may wait; and who sends what cannot be read on
a key of its own is told so.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from random import Random
from typing import Any, get_args

import msgspec

from colony.runtime.frames.clock import Clock
from colony.runtime.kit.description import field
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.calls import CallDispatcher, Method, Open
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES, MessageFormatError, check_plausible
from colony.runtime.protocol.images import Image
from colony.runtime.protocol.messages import (
    Announcement,
    Bounds,
    Call,
    Checkpoint,
    Effect,
    Fetch,
    Malformed,
    Message,
    Node,
    Ready,
    Recall,
    Reply,
    Request,
    Restart,
    Right,
    Sample,
    SendMessage,
    SentMessage,
    ServerFrame,
    Tick,
    Verdict,
    Wake,
)
from colony.runtime.servers.cserver import CServer
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.pserver import PServer
from colony.runtime.servers.rserver import RServer
from colony.runtime.servers.runtime_server import RuntimeServer
from colony.runtime.transport.live.keys import CallKey, carries_calls, check_call
from tests.kit.base import CLIENTS, RollingBase, deployed
from tests.kit.lift import move_command, service
from tests.kit.node_stage import FRAME_NS, NodeStage, S, messages
from tests.runtime.servers.nonsense import Grammar, Hints, Vandal, tree_bytes

KEEP = 40
USERS = ("ada/1", "ada/2", "bob/1", "carl/1", "eva/1")
WAITS = frozenset({"wait", "lock", "release", "tune", "move", "turn", "continuous_turn"})
"""Methods whose answer may come later."""


class Rings:
    """Sonars and infrared detectors that always see the same."""

    count = 24

    def sonar(self) -> Sample:
        return Sample((800.0,) * 24, 1)

    def infrared(self) -> Sample:
        return Sample((False,) * 24, 1)


class Film:
    """A camera with one small image."""

    def grab(self) -> Image:
        return Image(t_ns=1, height=3, width=4, channels=1, pixels=bytes(12))


def _clock() -> Node:
    return Clock(servers=("RServer", "PServer", "DServer", "Runtime"), frames_kept=KEEP)


def lift(done: list[tuple[float, bool]] | None = None) -> Node:
    """A server of a user, with a command; what it is made to do goes to `done`."""
    told = [] if done is None else done
    height = field("height", lambda: 1.0, unit="mm")
    return service(
        [height], [move_command(lambda height, fast: told.append((height, fast)))], lambda problem: None
    )


BUILD: dict[str, Callable[[], Node]] = {
    "Clock": _clock,
    "DServer": lambda: DServer(frames_kept=KEEP),
    "PServer": lambda: PServer(Rings(), frames_kept=KEEP),
    "RServer": lambda: RServer(RollingBase(), frames_kept=KEEP),
    "CServer": lambda: CServer(Film(), frames_kept=KEEP),
    "Runtime": lambda: RuntimeServer(frames_kept=KEEP),
}
"""A robot's servers, each as it is without a program."""

WITH_USERS = {**BUILD, "Lift": lift}
"""The same, and a server of a user."""


def methods_of(node: Node) -> dict[str, Method]:
    """All methods of a server, by name."""
    parts = [
        part for whole in (node, *vars(node).values()) for part in getattr(whole, "__dict__", {}).values()
    ]
    (desk,) = {id(part): part for part in parts if isinstance(part, CallDispatcher)}.values()
    return {name: method for name, (method, _) in desk._methods.items()}


class Stage(NodeStage):
    """One server, and all that anybody may send to it; it keeps the effects of the last message alone.

    Mutable: who has called, and the newest `ticks` where it is a Clock.

    Args:
        node: the server.
        random: what is drawn.
        rights: what callers are allowed, as the transport vouches for it.
        tame: frames are numbered as a Clock would: a server may be watched for long.
        run: of the ticks.
        without: methods that nobody calls.
    """

    def __init__(
        self,
        node: Node,
        random: Random,
        *,
        rights: tuple[Right, ...] = ("read", "command", "stop"),
        tame: bool = False,
        run: str = "",
        without: tuple[str, ...] = (),
    ) -> None:
        self.random, self.run, self.k, self.now_ns, self.node = random, run, 1000, S, node
        self.given = self.refused = self.answered = self.malformed = 0
        self._rights, self._tame = rights, tame
        self._grammar = Grammar(random, self._hints())
        self._vandal = Vandal(random)
        self._methods = {n: m for n, m in methods_of(node).items() if n not in without}
        self._topics = tuple(node.listens)
        self._kinds = get_args(SentMessage)
        self._numbers = dict.fromkeys(USERS, 0)
        self._deployment = msgspec.to_builtins(deployed())
        self.ticks: deque[Tick] = deque(maxlen=10)
        super().__init__(node, S)

    # --- what is sent --------------------------------------------------------------------------------

    def anything(self) -> None:
        """One thing that somebody sends, and a little time."""
        random = self.random
        chance = random.random()
        if chance < 0.04:
            self.tick()
        elif chance < 0.06:
            self.pass_time(random.choice((1, FRAME_NS, 300_000_000, 2_000_000_000)))
        else:
            topic = random.choice(self._topics)
            if random.random() < 0.5:
                topic = topics.calls(self.node.address)
            if carries_calls(topic):
                self._something_for_the_desk(topic)
            else:
                kind = random.choice((*self._kinds, *_USUAL.get(topic.rpartition("/")[2], ()) * 20))
                self.frame(topic, self._vandal.message(self._grammar.draw(kind)))
        self.pass_time(random.randrange(200_000))

    def tick(self) -> None:
        """A tick of the Clock, to who listens to it."""
        self.k += 1
        if topics.TICKS in self._topics:
            self.frame(topics.TICKS, codec.encode(Tick(k=self.k, t_ns=self.now_ns, run=self.run)))

    def frame(self, topic: str, data: bytes) -> None:
        """Bytes on a topic that is not one of calls; checked as a host does before it hands them on."""
        message: Message
        try:
            message = codec.decode(data)
            check_plausible(message, self.now_ns)
        except MessageFormatError as problem:
            message = Malformed(topic=topic, connection=None, reason=str(problem))
        if self._tame and isinstance(getattr(message, "k", 0), int) and getattr(message, "k", 0) > self.k:
            return
        self.give(message)

    def call(self, right: Right, connection: str, data: bytes) -> list[SentMessage]:
        """Bytes on the key of a caller; gives what the server says."""
        message: Message
        key = CallKey(right, connection)
        try:
            message = check_call(codec.decode(data), key)
        except MessageFormatError as problem:
            message = Malformed(
                topic=topics.calls(self.node.address), connection=connection, reason=str(problem)
            )
        said = self.give(message)
        replies = [s for s in said if isinstance(s, Reply) and s.connection == connection]
        match message:
            case Malformed():
                self.malformed += 1
                assert [(r.number, r.problem and r.problem.code) for r in replies][-1] == (0, "malformed")
            case Call(number=number):
                new = number > self._numbers[connection]
                self._numbers[connection] = max(number, self._numbers[connection])
                mine = [r for r in replies if r.number == number]
                assert len(mine) <= 1, f"{message} was answered twice"
                assert mine or not new or message.method in WAITS, f"{message} was not answered"
                self.answered += len(mine)
                self.refused += any(r.problem is not None for r in mine)
            case _:
                pass
        return said

    def do(self, method: str, arguments: msgspec.Struct) -> Any:
        """Look at something, on a connection that nothing is wrong with; gives the result."""
        connection, right = "eva/1", self._rights[0]
        if self._numbers[connection]:  # whatever it was before
            self.pass_time(10_000_000_000)
            self._numbers[connection] = 0
        result: Any = None
        for name, given in (("open", Open(name="sane")), (method, arguments)):
            number = min(self._numbers[connection] + 1, 2**64 - 1)
            raw = msgspec.Raw(msgspec.msgpack.encode(given))
            call = Call(connection=connection, number=number, method=name, arguments=raw, right=right)
            (reply,) = (s for s in self.call(right, connection, codec.encode(call)) if isinstance(s, Reply))
            assert reply.problem is None, reply.problem
            result = msgspec.msgpack.decode(reply.result)
        return result

    def _something_for_the_desk(self, topic: str) -> None:
        random = self.random
        connection, right = random.choice(USERS), random.choice(self._rights)
        if random.random() < 0.05:
            tree: Any = ["Alive", connection]
        else:
            name = random.choice(("open", *self._methods))
            method = self._methods[name]
            number = min(self._numbers[connection] + 1, 2**64 - 1)
            priority = USERS.index(connection)
            arguments = self._arguments(method)
            tree = ["Call", connection, number, name, arguments, priority, right]
        if random.random() < 0.3:
            self.call(right, connection, tree_bytes(tree))
        elif random.random() < 0.6 and tree[0] == "Call":
            tree[4] = self._vandal.change(tree[4])
            self.call(right, connection, tree_bytes(tree))
        else:
            self.call(right, connection, self._vandal.message(tree))

    def _arguments(self, method: Method) -> Any:
        if method.name == "deploy" and self.random.random() < 0.7:
            return {**self._deployment, "run": self.random.choice(("r1", "r2"))}
        return self._grammar.draw(method.arguments)

    def _hints(self) -> Hints:
        return {
            "k": lambda random: self.k + random.choice((0, 0, 0, 1, -1, -30, 5)),
            "start": lambda random: random.choice((0, self.k)),
            "t_ns": lambda random: self.now_ns,
            "name": lambda random: random.choice(("goal", "speed", "x", "mutex", "drive", "velocity")),
            "names": lambda random: ["goal", "x"][: random.randrange(3)],
            "prefixes": lambda random: ["g"][: random.randrange(2)],
            "length": lambda random: random.randrange(1, 6),
            "limit": lambda random: random.randrange(1, 20),
            "wait_ns": lambda random: random.choice((None, 0, 1_000_000, 100_000_000)),
            "server": lambda random: random.choice(("Clock", self.node.address, "RServer", "Runtime")),
            "actuator": lambda random: "drive",
            "client": lambda random: random.choice(CLIENTS)[0],
            "bid": lambda random: random.choice(("command", "command", "inactive", "silent", "inhibited")),
            "values": lambda random: random.choice(([random.uniform(-400, 600), 20.0], [1.0], None)),
            "sideways": lambda random: random.choice((0.0, 0.0, 0.0, -100.0, float("nan"))),
            "fault": lambda random: random.choice((None, None, None, "not finite")),
            "run": lambda random: random.choice(("", "r1", "r2")),
            "priority": lambda random: random.randrange(5),
            "memory": lambda random: random.choice((b"", b"\x90", bytes(100))),
        }

    # --- what comes of it ----------------------------------------------------------------------------

    def give(self, message: Message) -> list[SentMessage]:
        """Let the server handle this, and hold what it does to what a host can carry out."""
        self.given += 1
        try:
            return messages(self.handle(message), object)
        except Exception as problem:
            raise AssertionError(f"{self.node.address} failed at {message!r:.2000}: {problem!r}") from problem

    def wake(self) -> None:
        self.give(Wake())

    def keep(self, effects: Sequence[Effect]) -> None:
        self.effects.clear()
        self.replies.clear()
        super().keep(effects)
        for effect in effects:
            if isinstance(effect, SendMessage):
                assert effect.topic
                assert len(codec.encode(effect.message)) <= MAX_MESSAGE_BYTES
        self.ticks += messages(effects, Tick)


_USUAL: dict[str, tuple[type, ...]] = {
    "ticks": (Tick,),
    "fetches": (Fetch,),
    "requests": (Request, Request, Bounds),
    "announcements": (Announcement,),
    "checkpoints": (Checkpoint, Recall),
    "frames": (ServerFrame,),
    "ready": (Ready,),
    "restarts": (Restart,),
    "verdicts": (Verdict,),
}
"""What belongs on the topics of these ends."""
