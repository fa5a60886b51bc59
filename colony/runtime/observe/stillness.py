"""Why nothing moves while a program runs: one line for each cause, soon after the robot came to rest."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from colony.execute.compiled import Compiled
from colony.execute.needs import BOUNDS, sensors_without_default
from colony.ir.program import Sensor
from colony.ir.types import is_rate
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.deployment import limited_actuators
from colony.runtime.protocol.messages import Fate, Verdict
from colony.text.wording import listed

STILL_NS = 1_500_000_000
"""Nanoseconds at rest after which the cause is reported."""

_FAULTS = {
    "missing": "the command that won, or one of its limits, reads a missing value",
    "bound missing": "a limit reads a missing value",
    "not finite": "the command that won is not finite",
    "limits contradict": "the limits contradict each other",
}

MAX_LISTED = 5
"""Maximum number of sensors or clients that one line lists."""


class Stillness:
    """A sink that reports why nothing moves. Mutable.

    Only actuators with speeds or rates move; a program without any is never still.

    Args:
        compiled: the program.
        report: callback for a line, called once for each cause.

    Attributes:
        cause: the reason why nothing moves now; "" while something moves, or is at rest only for a moment.
    """

    def __init__(self, compiled: Compiled, report: Callable[[str], None] = lambda line: None) -> None:
        robot = compiled.robot
        self._moving = {
            a.name: tuple(i for i, field in enumerate(a.fields) if is_rate(field.type))
            for a in robot.actuators
            if any(is_rate(field.type) for field in a.fields)
        }
        self._servers = {a.name: a.server for a in robot.actuators}
        self._limited = frozenset(limited_actuators(compiled))
        self._needed = sensors_without_default(compiled.code)
        self._unread = {s.name for sensors in self._needed.values() for s in sensors}
        self._report = report
        self._reported: set[str] = set()
        self._rest_ns: int | None = None
        self.cause = ""

    @property
    def unread(self) -> tuple[str, ...]:
        """The sensors without a default that the program needs and that never had a value."""
        return tuple(sorted(self._unread))

    def take(self, log: RunFrame) -> None:
        """Take a frame; report the cause if nothing has moved for `STILL_NS`."""
        if self._unread:
            self._unread -= {name for name, value in log.frame.readings.items() if value is not None}
        if not self._moving or any(map(self._moves, log.verdicts.values())):
            self._rest_ns, self.cause = None, ""
            return
        if self._rest_ns is None:
            self._rest_ns = log.frame.t_ns
        if log.frame.t_ns - self._rest_ns >= STILL_NS:
            self.cause = "; ".join(self._cause(name, log) for name in self._moving)
            if self.cause not in self._reported:
                self._reported.add(self.cause)
                self._report(f"nothing moves: {self.cause}")

    def close(self) -> None:
        """Do nothing: the causes have been reported."""

    def _moves(self, verdict: Verdict) -> bool:
        values = verdict.values
        return values is not None and any(values[i] != 0.0 for i in self._moving.get(verdict.actuator, ()))

    def _cause(self, actuator: str, log: RunFrame) -> str:
        verdict = log.verdicts.get(actuator)
        if verdict is None:
            return f"{self._servers[actuator]} has sent no verdict for `{actuator}`"
        if verdict.hold == "stopped":
            return "the EMERGENCY STOP is on (`colony stop --release` ends it)"
        if verdict.hold == "locked":
            return f"{verdict.outside or 'a connection'} has locked `{actuator}`"
        if verdict.outside is not None:
            return f"{verdict.outside} commands `{actuator}` from outside the network"
        if verdict.fault is not None:
            reads = (*self._reads(actuator, verdict.by), *self._reads(actuator, BOUNDS))
            return "; ".join([_FAULTS.get(verdict.fault, verdict.fault), *self._missing(reads, log)])
        if verdict.by is not None:
            limit = ", or a limit holds it at 0" if actuator in self._limited else ""
            return f"`{verdict.by}` commands it to stand{limit}"
        return "; ".join(self._of_nobody(verdict, log))

    def _of_nobody(self, verdict: Verdict, log: RunFrame) -> Iterator[str]:
        """Yield why no module commands an actuator."""
        clients: dict[Fate, list[str]] = {}
        for name, fate in verdict.fates:
            clients.setdefault(fate, []).append(name)
        for fate in ("lost", "late"):
            if names := clients.get(fate):
                yield f"{_some([f'`{name}`' for name in names])} {'is' if len(names) == 1 else 'are'} {fate}"
        silent = (self._reads(verdict.actuator, name) for name in clients.get("silent", ()))
        missing = list(self._missing((s for sensors in silent for s in sensors), log))
        yield from missing
        if names := clients.get("inhibited"):
            yield f"{_some([f'`{name}`' for name in names])} {'is' if len(names) == 1 else 'are'} inhibited"
        if not missing and not ({"lost", "late", "inhibited"} & clients.keys()):
            yield f"no module commands `{verdict.actuator}` (`colony explain` of a recording says why)"

    def _reads(self, actuator: str, client: str | None) -> tuple[Sensor, ...]:
        """Return the sensors without a default that a client reads."""
        return self._needed.get((actuator, client or ""), ())

    def _missing(self, sensors: Iterable[Sensor], log: RunFrame) -> Iterator[str]:
        """Yield which of the sensors have no value, or none any more."""
        missing = [s for s in {s.name: s for s in sensors}.values() if log.frame.readings.get(s.name) is None]
        for what, found in (
            ("never had a value", [s for s in missing if s.name in self._unread]),
            ("missing", [s for s in missing if s.name not in self._unread]),
        ):
            if found:
                verb = "" if what.startswith("never") else "are " if found[1:] else "is "
                yield f"{_some([_sensor(s, log) for s in found])} {verb}{what}"


def _some(words: list[str]) -> str:
    more = [f"{len(words) - MAX_LISTED} more"] if len(words) > MAX_LISTED else []
    return listed([*words[:MAX_LISTED], *more])


def _sensor(sensor: Sensor, log: RunFrame) -> str:
    """Return a sensor with its field, or with its server if that is down."""
    source = f"{sensor.server}.{sensor.field}"
    return f"`{sensor.name}` ({f'{sensor.server} is down' if sensor.server in log.tick.down else source})"
