"""Devices that follow a script, and note what they are told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from colony.compile.pipeline import compile_program
from colony.ir.program import Program
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import BaseLimits, BaseState, Drivers
from colony.runtime.transport.virtual import VirtualClock
from tests.robot_servers import ROME_SERVERS

FAR = (5000.0,) * 24
LIMITS = BaseLimits(velocity=600.0, turn=90.0, acceleration=800.0, turn_acceleration=240.0)


@dataclass(frozen=False, slots=True, kw_only=True)
class Script:
    """`sonar_at` and `bumper_at` give readings for a time in ns; `told` is (time, velocity, turn)."""

    clock: VirtualClock = field(default_factory=VirtualClock)
    sonar_at: Callable[[int], Sample | None] = lambda t: Sample(FAR, t)
    bumper_at: Callable[[int], bool] = lambda t: False
    told: list[tuple[int, float, float]] = field(default_factory=list)
    stopped: list[int] = field(default_factory=list)
    limits: BaseLimits = LIMITS
    register_bits: int | None = None

    count = 24

    def drive(self, velocity: float, turn: float) -> None:
        self.told.append((self.clock(), velocity, turn))

    def stop(self) -> None:
        self.stopped.append(self.clock())

    def state(self) -> BaseState | None:
        return BaseState(
            t_ns=self.clock(),
            x=0.0,
            y=0.0,
            heading=0.0,
            front_bumper=self.bumper_at(self.clock()),
            rear_bumper=False,
            speed=0.0,
            turn_rate=0.0,
            wheel_speed=0.0,
        )

    def sonar(self) -> Sample | None:
        return self.sonar_at(self.clock())

    def infrared(self) -> Sample | None:
        return None

    @property
    def drivers(self) -> Drivers:
        return Drivers(servers=ROME_SERVERS, base=self, proximity=self)


class Log:
    """A sink that keeps everything."""

    def __init__(self) -> None:
        self.frames: list[RunFrame] = []
        self.closed = 0

    def take(self, log: RunFrame) -> None:
        self.frames.append(log)

    def close(self) -> None:
        self.closed += 1

    def winners(self, actuator: str = "drive") -> list[str | None]:
        return [log.verdicts[actuator].by for log in self.frames]


def session(program: Program, script: Script, *sinks: object, **options: object) -> VirtualSession:
    """A session of a program over a script, with seed 1 unless told otherwise."""
    settings: dict[str, object] = {"seed": 1} | options
    compiled = compile_program(program).compiled
    return VirtualSession(compiled, script.drivers, clock=script.clock, sinks=sinks, **settings)  # type: ignore[arg-type]
