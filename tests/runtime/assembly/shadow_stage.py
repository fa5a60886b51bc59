"""A shadow on a stage: ticks of 50 ms, and servers that answer them or not."""

from __future__ import annotations

from collections.abc import Mapping

from colony.analysis.audit import audit
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.runtime.assembly.shadow import Shadow
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.messages import Sample, ServerFrame, Tick
from tests.kit.node_stage import MS, NodeStage
from tests.robot_servers import ROME_SERVERS
from tests.runtime.scripted import FAR, Log

ROBOT = """language 1
robot rome {
  sensor sonar[24] : mm  bearing -180 deg  range 0 .. 10000  from PServer.sonar  within 300 ms
  sensor bumper    : bool                  from RServer.bumper within 300 ms
  sensor wish      : mm/s  default 0       from DServer.Wish
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive  idle drive(velocity = 0, turn = 0)
}
"""

RAMP = f"""{ROBOT}
let before = value_or(last.drive.velocity, 0 mm/s)
module cruise {{ when true  do drive(velocity = before + 7 mm/s, turn = 0) }}
module avoid  {{ when recently(min(sonar) < 900 mm, 400 ms)  do drive(velocity = 60 mm/s, turn = 30 deg/s) }}
module blind  {{ when not fresh(bumper)  do drive(velocity = 0, turn = 5 deg/s) }}
network {{ drive = blind suppresses avoid suppresses cruise }}
limit drive.velocity <= 300 mm/s
contract slow: drive.velocity <= 300 mm/s
contract through: last.drive by avoid implies last.cruise is active and not (last.drive by cruise)
"""


def program(text: str) -> Program:
    return load_text(text, "test.colony")


def shadow(text: str, *sinks: object) -> Shadow:
    compiled = compile_program(program(text)).compiled
    bindings = bind(compiled.robot, ROME_SERVERS)
    deployed = deployment(compiled, bindings, run="shadow", seed=0)
    return Shadow(compiled, bindings, deployed, sinks)  # type: ignore[arg-type]


READINGS: Mapping[str, Mapping[str, object]] = {
    "PServer": {"sonar": FAR},
    "RServer": {"bumper": False},
    "DServer": {"Wish": 0.0},
}


class Stage(NodeStage):
    """Ticks of 50 ms from frame 1000 on, and the servers that answer them."""

    node: Shadow

    def __init__(self, text: str = RAMP) -> None:
        self.log = Log()
        super().__init__(shadow(text, self.log))

    def tick(self, k: int, *, now_ns: int = 0, **members: object) -> None:
        settings = {"start": 17, "run": "another", **members}
        self.advance(now_ns)
        self.handle(Tick(k=1000 + k, t_ns=(1000 + k) * 50 * MS, **settings))  # type: ignore[arg-type]

    def answer(self, k: int, *servers: str) -> None:
        t_ns = (1000 + k) * 50 * MS
        for server in servers or READINGS:
            fields = {name: Sample(value, t_ns) for name, value in READINGS[server].items()}  # type: ignore[arg-type]
            self.handle(ServerFrame(server=server, k=1000 + k, fields=fields))

    def frames(self, ks: range, *servers: str, **members: object) -> None:
        for k in ks:
            self.tick(k, **members)
            self.answer(k, *servers)

    def ks(self) -> list[int]:
        return [log.tick.k - 1000 for log in self.log.frames]

    def restarts(self) -> list[int]:
        return [log.tick.k - 1000 for log in self.log.frames if log.restart]

    def close(self) -> None:
        self.node.close()
        assert self.effects == []
        assert audit(program(RAMP), self.log.frames).agrees
        assert not any(log.disagreements for log in self.log.frames)
