"""A robot of three actuators whose base is driven from outside too: the real servers, of which every process
can die, with sensors that fail, and connections that command, lock and stop now and then."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from random import Random
from typing import Any, Literal, NamedTuple

from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.runtime.assembly.scripted import FrameCollector
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.script import Script as Generator
from colony.runtime.kit.script import do, sleep
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.library import clock, data, emergency, robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.bindings import Bindings, bind
from colony.runtime.protocol.messages import Message, Sample, ServerFrame, Verdict
from colony.runtime.servers.drivers import BaseState
from colony.runtime.transport.exchange import Delay, Link
from tests.robot_servers import ROME_SERVERS
from tests.runtime.scripted import Script, session
from tools.loss.oracle import MS, Seen

TEXT = """
language 1
robot r {{
  frame {frame_ms} ms
  sensor sonar[24] : mm range 0 .. 10000 from PServer.sonar within {within_ms} ms
  sensor bumper : bool from RServer.front_bumper within {within_ms} ms
  sensor goal : mm range 0 .. 500 from DServer.Goal within 900 ms
  sensor height : mm from DServer.Lift
  actuator drive {{ velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }}
           to RServer.drive idle drive(velocity = 0, turn = 0)
  actuator lift {{ height : mm range 0 .. 400 }} to DServer.Lift idle hold
  actuator lamp {{ light : number range 0 .. 1, blink : bool }} to DServer.Lamp
           idle lamp(light = 0, blink = false)
}}

let lifted = value_or(last.lift.height, 400 mm)
state frames = 0
next frames = if frames < 9 then frames + 1 else 0

failsafe module avoid {{ when sonar[0] < 1500 mm do drive(velocity = -60 mm/s, turn = 20 deg/s) }}
module wander {{ when recently(sonar[0] > 3 m, 1 s) do drive(velocity = 300 mm/s, turn = frames * 1 deg/s) }}
module raise {{ when goal > 10 mm do lift(height = goal) }}
module sink {{ when last.drive.velocity > 150 mm/s do lift(height = 20 mm) }}
module shine {{ when last.lift.height > 100 mm do lamp(light = 1, blink = bumper) }}
module glow {{ when sustained(last.drive.velocity > 20 mm/s, 500 ms)
  do lamp(light = frames / 10, blink = false) }}

network {{
  drive = avoid suppresses{constant} wander
  lift = sink suppresses raise
  lamp = shine suppresses{constant} glow
}}

limit drive.velocity <= max(last.drive.velocity, 0 mm/s) + {ramp} mm/s^2 * frame_period
limit drive.velocity <= sonar[0] / 10 s
limit drive.velocity <= 0 mm/s when bumper
limit drive.velocity <= 120 mm/s when lifted > 100 mm
limit drive.turn >= -30 deg/s when recently(bumper, 1 s)
limit lift.height <= 60 mm when last.drive.velocity > 120 mm/s
limit lamp.light <= 0.9
{more}

contract safe_slow: fresh(sonar) implies drive.velocity <= sonar[0] / 10 s
contract safe_bump: bumper implies drive.velocity <= 0 mm/s
contract safe_ramp: drive.velocity <= max(last.drive.velocity, 0 mm/s) + {ramp} mm/s^2 * frame_period
contract safe_lift: lifted > 100 mm implies drive.velocity <= 120 mm/s
contract safe_lamp: lamp.light <= 0.9
contract through: last.drive by wander implies last.wander is active
contract lift_through: last.lift by sink implies last.sink is active and not (last.lift by raise)
contract own: not (drive by wander) or sonar[0] > 1 m
contract nobody: not (drive is commanded)
contract before: lamp.light <= 0.5 or recently(drive is idle, 1 s)
"""

MORE = (
    "",
    "limit drive.velocity >= 50 mm/s when goal > 300 mm",
    "limit lift.height <= value_or(last.lift.height, 50 mm) + 40 mm",
)
"""Limits of some variants: one that contradicts others at times, one of a field that is held."""


@lru_cache(maxsize=8)
def variant(number: int, frame_ms: int) -> Program:
    """Variant `number` of the program."""
    text = TEXT.format(
        frame_ms=frame_ms,
        within_ms=max(300, 2 * frame_ms),
        constant=("", "[700 ms]")[number % 2],
        ramp=(500, 4000)[number // 2 % 2],
        more=MORE[number % len(MORE)],
    )
    return load_text(text)


SERVERS = ("RServer", "PServer", "DServer", "Runtime")


class Happened(NamedTuple):
    """One thing that happened to a server, in order: a frame, a verdict, a command, a stop, its death.

    `what` is the message, or the command (velocity and turn) that the base was told.
    """

    kind: Literal["frame", "verdict", "told", "stopped", "killed"]
    server: str
    t_ns: int
    what: Any = None


@dataclass(frozen=False, slots=True, kw_only=True)
class Devices(Script):
    """Devices that note in `happened` what they are told."""

    happened: list[Happened] = field(default_factory=list)

    def drive(self, velocity: float, turn: float) -> None:
        self.happened.append(Happened("told", "RServer", self.clock(), (velocity, turn)))

    def stop(self) -> None:
        self.happened.append(Happened("stopped", "RServer", self.clock()))

    def state(self) -> BaseState | None:
        if self.sonar_at(self.clock() // 2 + 1) is None:  # the base fails as the sonar does, at other times
            return None
        return Script.state(self)


class Readings:
    """Readings drawn anew every 300 ms, of sensors that fail at times until `until_ns`."""

    def __init__(self, random: Random, until_ns: int) -> None:
        def drawn() -> float | None:
            if random.random() < 0.15:
                return None
            return random.choice((400.0, 1200.0, 2000.0, 3500.0, 5000.0, 9000.0)) * random.uniform(0.9, 1.1)

        self._until_ns = until_ns
        self._ahead = [drawn() for _ in range(until_ns // (300 * MS) + 1)]
        self._bumped = [random.random() < 0.2 for _ in self._ahead]

    def sonar(self, t_ns: int) -> Sample | None:
        ahead = self._ahead[t_ns // (300 * MS)] if t_ns < self._until_ns else 4000.0
        return None if ahead is None else Sample((ahead, *[5000.0] * 23), t_ns)

    def bumper(self, t_ns: int) -> bool:
        return t_ns < self._until_ns and self._bumped[t_ns // (300 * MS)]


Asks = Callable[[Random], tuple[str, CallRequest[Any]]]
"""A function that draws what to ask of which server."""


class Connection(NamedTuple):
    """A connection: its name, what it asks, its servers, its priority."""

    name: str
    asks: Asks
    servers: tuple[str, ...]
    priority: int


class Robot:
    """One run of a program. `script` draws what connections do until the faults end."""

    _stoppable: tuple[str, ...] = ("RServer", "DServer")
    servers: tuple[str, ...] = SERVERS
    """Servers whose frames the program reads, or that have its actuators."""

    def __init__(
        self, program: Program, *, seed: int, random: Random, until_ns: int, link: Link, isolate: bool
    ) -> None:
        self.program = program
        self.bindings = self._bind()
        self.seen = Seen()
        self.happened: list[Happened] = []
        self.log = FrameCollector()
        self.ignoring = random.random() < 0.2
        self._link = link
        self._noted: set[tuple[str, str, int]] = set()
        readings = Readings(random, until_ns)
        self.devices = Devices(sonar_at=readings.sonar, bumper_at=readings.bumper, happened=self.happened)
        self.scripts = tuple(
            ScriptNode(
                name, self._script(Random(f"{seed} {name}"), until_ns, asks), servers, priority=priority
            )
            for name, asks, servers, priority in self._connections()
        )
        self.session = self._session(seed, isolate)

    def _bind(self) -> Bindings:
        return bind(self.program.robot, ROME_SERVERS)

    def _connections(self) -> Sequence[Connection]:
        """The connections, from the one that commands before all modules on."""
        return (
            Connection("above", self._motion, ("RServer",), 50),
            Connection("below", self._motion, ("RServer",), 0),
            Connection("console", self._note, ("DServer", "Clock", "RServer"), 1),
        )

    def _session(self, seed: int, isolate: bool) -> VirtualSession:
        return session(
            self.program,
            self.devices,
            self.log,
            seed=seed,
            link=self._noting,
            isolate=isolate,
            nodes=self.scripts,
        )

    @property
    def now_ns(self) -> int:
        return self.devices.clock()

    def kill(self, process: str) -> None:
        self.happened.append(Happened("killed", process, self.now_ns))
        self.session.kill(process)

    def _noting(self, sender: str, receiver: str, message: Message) -> Delay:
        self.seen.note(sender, message)
        if isinstance(message, ServerFrame | Verdict):
            kind: Literal["frame", "verdict"] = "frame" if isinstance(message, ServerFrame) else "verdict"
            of = "" if isinstance(message, ServerFrame) else message.actuator
            key = (f"{kind} {of}", sender, message.k)
            if key not in self._noted:
                self._noted.add(key)
                self.happened.append(Happened(kind, sender, self.now_ns, message))
        return self._link(sender, receiver, message)

    def _script(self, random: Random, until_ns: int, asks: Asks) -> Generator:
        """Call something every now and then, begin no call after `until_ns`; at the end, undo what lasts.

        A call that has begun may take 2 s more (a motion without progress); what it set in motion, and the
        lock, end with the script.
        """
        while (yield from sleep(random.choice((0.01, 0.1, 0.1, 0.4, 0.4, 1.5)))) < until_ns:
            server, ask = asks(random)
            yield from _called(server, ask)
        if asks == self._note:
            yield from sleep(1.0)
            for _ in range(3):
                yield from _called("Clock", clock.release())

    def _motion(self, random: Random) -> tuple[str, CallRequest[Any]]:
        velocity, turn = random.choice((-400.0, 30.0, 100.0, 250.0, 600.0)), random.uniform(-60.0, 60.0)
        lease, wait = random.choice((0.1, 0.5, 0.5, 2.0)), random.random() < 0.3
        kind = random.choice(
            ("drive", "drive", "drive", "go", "jog", "move", "turn", "lock", "unlock", "stop")
        )
        asks: dict[str, Callable[[], CallRequest[Any]]] = {
            "drive": lambda: robot.drive(velocity, turn, lease),
            "go": lambda: robot.go(velocity, lease),
            "jog": lambda: robot.jog(turn, lease),
            "move": lambda: robot.move(10.0 * turn, velocity=abs(velocity), wait=wait),
            "turn": lambda: robot.turn(turn, velocity=30.0, wait=wait),
            "lock": lambda: robot.lock(wait=wait, wait_s=1.0),
            "unlock": robot.unlock,
            "stop": lambda: robot.stop(random.randrange(2), lease),
        }
        if self.ignoring and random.random() < 0.2:
            return "RServer", robot.ignore_limits(random.random() < 0.6)
        return "RServer", asks[kind]()

    def _note(self, random: Random) -> tuple[str, CallRequest[Any]]:
        """Set the goal; press and release the emergency stop now and then."""
        draw = random.random()
        if draw < 0.05:
            return random.choice(("Clock", *self._stoppable)), emergency.stop()
        if draw < 0.3:
            return "Clock", clock.release()
        return "DServer", data.set("Goal", random.choice((5.0, 80.0, 200.0, 350.0)))


def _called(server: str, ask: CallRequest[Any]) -> Generator:
    try:
        yield from do(server, ask)
    except RobotConnectionError:
        return
