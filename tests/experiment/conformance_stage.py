"""The same program and scripts in the loop of experiments and among the real servers in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from colony.dsl.load import load_text
from colony.execute.intake import converted
from colony.ir.frame import Decision, Frame, Outcome
from colony.ir.program import in_declared_units
from colony.runs.behavior import behavior_from
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.kit.script import Script
from colony.runtime.protocol.images import Image
from colony.sim.world.world import World
from tests.among_servers import FRAME_NS, run_among_servers
from tests.experiment.loops import loop_of

PROGRAM = """
robot tester {
  frame    50 ms
  sensor   sonar[24] : mm         range 0 .. 10000          from PServer.sonar            within 300 ms
  sensor   infrared[24] : bool                              from PServer.infrared         within 300 ms
  sensor   front_bumper : bool                              from RServer.front_bumper     within 300 ms
  sensor   x : m                                            from RServer.x                within 300 ms
  sensor   heading : deg          range 0 .. 360            from RServer.heading          within 300 ms
  sensor   random : number        range 0 .. 1              from Runtime.random
  sensor   wanted : mm/s          range -600 .. 600         from DServer.Wanted           within 400 ms
  sensor   turning : deg/s        range -90 .. 90           default 0 from DServer.Turning
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive       idle drive(velocity = 0, turn = 0)
  actuator report { where : m, chance : number }  to DServer.Report  idle hold
  actuator count { number : number }              to DServer.Count   idle hold
}
module go    { when fresh(wanted)      do drive(velocity = wanted, turn = turning) }
module tell  { when sonar[12] < 9000 mm do report(where = x, chance = random) }
module steps {
  state n : number = 0
  next n = n + 1
  when infrared[12] or not front_bumper  do count(number = n)
}
network {
  drive  = go
  report = tell
  count  = steps
}
"""

WALLS = [(-3e3, -2e3, 9e3, -2e3), (9e3, -2e3, 9e3, 2e3), (9e3, 2e3, -3e3, 2e3), (-3e3, 2e3, -3e3, -2e3)]
CAMERA = "CServerUp"

Decided = tuple[Frame, tuple[Decision, ...]]
"""What the network read in a frame, in base units, and what it decided, in declared ones."""

Log = list[tuple[object, ...]]
Scripts = Callable[[Mapping[str, Log]], Mapping[str, Script]]
"""Scripts by name, each of which notes in its log what it saw."""


def frame_of(t_ns: int) -> int:
    """Nodes run a nanosecond after the beginning of a frame."""
    return t_ns // FRAME_NS


def _world() -> World:
    return World(walls=WALLS, poses=[(0.0, 0.0, 270.0)], seed=5)


def _image(t_ns: int, x_mm: float) -> Image:
    pixels = bytes((t_ns // FRAME_NS + round(x_mm) + i) % 256 for i in range(12))
    return Image(t_ns=t_ns, height=3, width=4, channels=1, pixels=pixels)


def in_loop(make: Scripts, logs: Mapping[str, Log], frames: int) -> list[Decided]:
    """What the network decided, frame by frame."""
    decided: list[Decided] = []
    world, behavior = _world(), behavior_from(load_text(PROGRAM))

    def watch(frame: Frame, outcome: Outcome) -> None:
        pairs = zip(outcome.decisions, behavior.robot.actuators, strict=True)
        declared = (d._replace(values=in_declared_units(d.values, a.fields)) for d, a in pairs)
        decided.append((frame, tuple(declared)))

    loop = loop_of(
        behavior,
        world,
        make(logs),
        cameras={CAMERA: lambda now_ns: _image(now_ns, world.true_pose(0).x_mm)},
        seed=3,
        watch=watch,
    )
    for _ in range(frames):
        loop.frame()
    loop.close()
    return decided


class _Decisions:
    def __init__(self) -> None:
        self.decided: list[Decided] = []
        self._factors = {s.name: s.factor for s in load_text(PROGRAM).robot.sensors}

    def take(self, log: RunFrame) -> None:
        assert not log.disagreements
        readings = {
            name: converted(reading, self._factors[name].__mul__)
            for name, reading in log.frame.readings.items()
        }
        self.decided.append((log.frame._replace(readings=readings), log.expected.decisions))

    def close(self) -> None:
        """It holds nothing."""


def among_servers(make: Scripts, logs: Mapping[str, Log], frames: int, order_seed: int) -> list[Decided]:
    """The same, among the real servers, with messages of one moment in an order drawn from `order_seed`."""
    sink, world = _Decisions(), _world()
    run_among_servers(
        PROGRAM,
        world,
        make(logs),
        run_ns=frames * FRAME_NS,
        seed=3,
        order=order_seed,
        cameras={CAMERA: lambda now: _image(now, world.true_pose(0).x_mm)},
        sinks=(sink,),
    )
    return sink.decided
