"""A robot with three actuators at three servers, each commanded from outside too: RServer's drive, a variable
of DServer, and a lift whose server is written with the kit. Every process can die."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from random import Random
from typing import Any

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.runtime.assembly.virtual import Builders, VirtualRobot
from colony.runtime.kit.commands import Command, command, parameter
from colony.runtime.kit.description import Description, Field, FieldReader, field, server_spec
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.kit.script import Script as Generator
from colony.runtime.kit.script import do, sleep
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.kit.service import Service
from colony.runtime.library import actuator
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.clock import deploy
from colony.runtime.protocol.bindings import Bindings, bind
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.messages import Effect, Message, ServerFrame
from colony.runtime.servers.drivers import Reading
from colony.runtime.servers.dserver import DServer
from colony.runtime.servers.pserver import PServer
from colony.runtime.servers.rserver import RServer
from colony.runtime.servers.runtime_server import RuntimeServer
from colony.runtime.store.store import MemoryStore
from colony.runtime.transport.exchange import Delay
from tests.robot_servers import ROME_SERVERS
from tools.loss import outside_stage
from tools.loss.outside_stage import Connection, Happened

TEXT = """
language 1
robot r {{
  frame {frame_ms} ms
  sensor sonar[24] : mm range 0 .. 10000 from PServer.sonar within {within_ms} ms
  sensor bumper : bool from RServer.front_bumper within {within_ms} ms
  sensor goal : mm range 0 .. 500 from DServer.Goal within 900 ms
  sensor height : mm from Lift.height within {within_ms} ms
  actuator drive {{ velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }}
           to RServer.drive idle drive(velocity = 0, turn = 0)
  actuator lift {{ height : cm range 0 .. 40, fast : bool }} to Lift.move {lift_idle}
  actuator lamp {{ light : number range 0 .. 1 }} to DServer.Lamp {lamp_idle}
}}

let lifted = value_or(last.lift.height, 400 mm)
state frames = 0
next frames = if frames < 9 then frames + 1 else 0

failsafe module avoid {{ when sonar[0] < 1500 mm do drive(velocity = -60 mm/s, turn = 20 deg/s) }}
module wander {{ when recently(sonar[0] > 3 m, 1 s) do drive(velocity = 300 mm/s, turn = frames * 1 deg/s) }}
module raise {{ when goal > 10 mm do lift(height = min(goal, 400 mm), fast = height < 50 mm) }}
module sink {{ when last.drive.velocity > 150 mm/s do lift(height = 20 mm, fast = true) }}
module shine {{ when last.lift.height > 100 mm do lamp(light = 1) }}
module glow {{ when sustained(last.drive.velocity > 20 mm/s, 500 ms) do lamp(light = frames / 10) }}

network {{
  drive = avoid suppresses{constant} wander
  lift = sink suppresses raise
  lamp = shine suppresses{constant} glow
}}

limit drive.velocity <= sonar[0] / 10 s
limit drive.velocity <= 0 mm/s when bumper
limit drive.velocity <= 120 mm/s when lifted > 100 mm
limit lift.height <= 60 mm when last.drive.velocity > 120 mm/s
limit lift.height <= 300 mm when recently(bumper, 1 s)
limit lift.height <= height + 150 mm
limit lamp.light <= 0.9
limit lamp.light <= 0.2 when bumper
{more}

contract safe_slow: fresh(sonar) implies drive.velocity <= sonar[0] / 10 s
contract safe_bump: bumper implies drive.velocity <= 0 mm/s
contract safe_lift: lifted > 100 mm implies drive.velocity <= 120 mm/s
contract safe_lamp: lamp is commanded implies lamp.light <= 0.9
contract own: not (lift by raise) or goal > 10 mm
contract nobody: not (lift is commanded)
"""

MORE = (
    "",
    "limit lift.height >= 50 mm when goal > 300 mm",
    "limit lamp.light <= value_or(last.lamp.light, 0.1) + 0.3",
)
"""Limits of some variants: one that contradicts others at times, one that follows what was sent."""


@lru_cache(maxsize=8)
def variant(number: int, frame_ms: int) -> Program:
    """Variant `number` of the program."""
    return load_text(
        TEXT.format(
            frame_ms=frame_ms,
            within_ms=max(300, 2 * frame_ms),
            constant=("", "[700 ms]")[number % 2],
            lift_idle=("idle lift(height = 10 mm, fast = false)", "idle hold")[number // 2 % 2],
            lamp_idle=("idle lamp(light = 0)", "idle hold")[number // 4 % 2],
            more=MORE[number % len(MORE)],
        )
    )


class Session(VirtualRobot):
    """The processes of the robot, with the run of its program."""

    def run(self, duration_ns: int) -> None:
        """Run the frames from 0 to before `duration_ns`, once."""
        self.start()
        self.transport.run_until(duration_ns)
        self.observer.close()


class Robot(outside_stage.Robot):
    """One run of a program. Mutable: `height` is where the lift is."""

    servers = (*outside_stage.SERVERS, "Lift")
    _stoppable = ("RServer", "DServer", "Lift")

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.height = 100.0
        self.lift_idle: tuple[Any, ...] | None = None
        super().__init__(*arguments, **options)

    def _bind(self) -> Bindings:
        described = Description(
            server="Lift", fields=(self._height().description,), commands=(self._move().description,)
        )
        return bind(self.program.robot, (*ROME_SERVERS, server_spec(described)))

    def _connections(self) -> Sequence[Connection]:
        return (
            Connection("above", self._motion, ("RServer",), 50),
            Connection("below", self._motion, ("RServer",), 0),
            Connection("above lift", self._raise, ("Lift",), 51),
            Connection("below lift", self._raise, ("Lift",), -1),
            Connection("above lamp", self._light, ("DServer",), 52),
            Connection("below lamp", self._light, ("DServer",), -2),
            Connection("console", self._note, ("DServer", "Clock", "RServer", "Lift"), 1000),
        )

    def _session(self, seed: int, isolate: bool) -> Any:
        store = MemoryStore()

        def servers(deployed: Deployment, frames_kept: int) -> Builders:
            drivers = self.devices.drivers
            assert drivers.base is not None
            assert drivers.proximity is not None
            base, proximity = drivers.base, drivers.proximity
            return {
                "RServer": lambda: RServer(base, deployment=deployed, frames_kept=frames_kept),
                "PServer": lambda: PServer(proximity, frames_kept=frames_kept),
                "DServer": lambda: self._noting_halts(
                    DServer(deployment=deployed, frames_kept=frames_kept, store=store)
                ),
                "Runtime": lambda: RuntimeServer(seed, frames_kept=frames_kept),
                "Lift": lambda: Service(
                    "Lift", (), FieldReader("Lift", [self._height()], _fail), _fail, commands=[self._move()]
                ),
            }

        def lead() -> Generator:
            """Keep the program deployed to the lift, as the leader does."""
            while True:
                with suppress(RobotConnectionError):
                    yield from do("Lift", deploy(session.deployed))
                yield from sleep(0.2)

        session = Session(
            compile_program(self.program).compiled,
            self.bindings,
            servers,
            clock=self.devices.clock,
            seed=seed,
            sinks=(self.log,),
            link=self._noting,
            isolate=isolate,
            nodes=(*self.scripts, ScriptNode("leader", lead(), ("Lift",), priority=-100)),
        )
        return session

    def _noting_halts(self, server: DServer) -> DServer:
        """Note when the server makes its variables idle whatever frames decide."""
        actuators = server._actuators
        for name in ("_halt_all", "_halt_program"):
            setattr(actuators, name, partial(self._note_halt, getattr(actuators, name)))
        return server

    def _note_halt(self, halt: Callable[[int], Iterator[Effect]], now_ns: int) -> Iterator[Effect]:
        self.happened.append(Happened("stopped", "DServer", now_ns))
        return halt(now_ns)

    def _noting(self, sender: str, receiver: str, message: Message) -> Delay:
        if isinstance(message, ServerFrame) and sender == "Lift" and not message.fields:
            return self._link(sender, receiver, message)  # the Clock's copy
        return super()._noting(sender, receiver, message)

    # --- the lift ------------------------------------------------------------------------------------

    def _height(self) -> Field:
        def read() -> Reading | None:
            failed = self.devices.sonar_at(self.now_ns // 3 + 1) is None  # as the sonar does, at other times
            return None if failed else Reading(self.height, age_ns=0)

        return field("height", read, unit="mm", has_age=True)

    def _move(self) -> Command:
        def move(height: float, fast: bool) -> None:
            self.happened.append(Happened("told", "Lift", self.now_ns, (height, fast)))
            self.height += max(-50.0, min(50.0, height - self.height))

        def safe() -> None:
            self.happened.append(Happened("stopped", "Lift", self.now_ns))

        return command(
            "move",
            move,
            parameter("height", unit="mm", low=0.0, high=400.0),
            parameter("fast", boolean=True),
            safe=safe,
        )

    # --- what connections ask ------------------------------------------------------------------------

    def _raise(self, random: Random) -> tuple[str, CallRequest[Any]]:
        height, fast = random.choice((0.0, 30.0, 90.0, 250.0, 400.0, 500.0)), random.random() < 0.5
        return "Lift", self._commanded(random, "move", {"height": height, "fast": fast})

    def _light(self, random: Random) -> tuple[str, CallRequest[Any]]:
        return "DServer", self._commanded(random, "Lamp", {"light": random.choice((0.0, 0.1, 0.5, 1.0, 2.0))})

    def _commanded(self, random: Random, name: str, values: dict[str, bool | float]) -> CallRequest[Any]:
        wait = random.random() < 0.3
        asks: dict[str, Callable[[], CallRequest[Any]]] = {
            "command": lambda: actuator.command(name, values, random.choice((0.1, 0.5, 0.5, 2.0))),
            "lock": lambda: actuator.lock(wait=wait, wait_s=1.0),
            "unlock": actuator.unlock,
        }
        if self.ignoring and random.random() < 0.2:
            return actuator.ignore_limits(random.random() < 0.6)
        return asks[random.choice(("command", "command", "command", "command", "lock", "unlock"))]()


def _fail(problem: str) -> None:
    raise AssertionError(problem)
