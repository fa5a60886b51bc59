"""Comparison of a program in the shadow of a robot with the controller that drives it: data and text."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from statistics import median

from colony.execute.compiled import Compiled
from colony.ir.program import Actuator, ActuatorField
from colony.ir.types import Enum, Quantity, ScalarValue
from colony.runtime.frames.run_frame import HeardCommand, RunFrame
from colony.runtime.protocol.messages import Verdict
from colony.text.wording import counted, seconds_of

DEFAULT_TOLERANCE = 1.0
"""Tolerance of two equal commands, in percent of the range of a field."""

MAX_KEPT = 1 << 17
"""Maximum number of differences that a median is taken of; then every other one is dropped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldDifference:
    """The differences of a field of a command, in its declared unit: their median, and the worst."""

    field: str
    unit: str
    median: float
    worst: float
    worst_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleComparison:
    """The frames in which `module` would have commanded, or none (None), and those with the same command."""

    module: str | None
    frames: int
    same: int
    fields: tuple[FieldDifference, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorComparison:
    """The commands of an actuator.

    Attributes:
        actuator: its name.
        topic: the topic of the controller's commands.
        frames: the number of frames with a command of the controller.
        silent: the number of frames without one.
        same: the number of frames with the same command.
        tolerance: the tolerance of each field, in its declared unit.
        modules: the frames by the module that would have commanded.
    """

    actuator: str
    topic: str
    frames: int
    silent: int
    same: int
    tolerance: Mapping[str, float]
    modules: tuple[ModuleComparison, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerBreach:
    """A contract that the controller broke in `frames` frames, the first of them `first_k`."""

    contract: str
    frames: int
    first_k: int
    first_s: float
    last_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerReport:
    """The comparison with the controller.

    Attributes:
        actuators: the actuators whose topics are heard.
        breaches: the contracts that it broke.
        held: the contracts that it held in every frame.
        unjudged: the contracts that it cannot be judged by, with the reasons.
    """

    actuators: tuple[ActuatorComparison, ...]
    breaches: tuple[ControllerBreach, ...]
    held: tuple[str, ...]
    unjudged: Mapping[str, str]

    def as_json(self) -> dict[str, object]:
        """Return the report as plain dicts and lists."""
        return asdict(self)


# --- the comparison in progress ----------------------------------------------------------------------


class ControllerComparison:
    """A sink that compares the commands of each frame. Mutable: counts, and differences.

    Args:
        compiled: the program.
        topics: the topic of each actuator that is heard.
        unjudged: the contracts that the controller cannot be judged by, with the reasons.
        tolerance: in percent of the range of a field.
    """

    def __init__(
        self,
        compiled: Compiled,
        topics: Mapping[str, str],
        unjudged: Mapping[str, str],
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> None:
        self._contracts = tuple(c.name for c in compiled.contracts if not c.assumed)
        self._topics, self._unjudged = topics, unjudged
        self._actuators = {
            a.name: _Compared(a, compiled.clients_by_actuator[a.name], tolerance)
            for a in compiled.robot.actuators
            if a.name in topics
        }
        self._breaches: dict[str, ControllerBreach] = {}

    def take(self, log: RunFrame) -> None:
        """Compare a frame."""
        t_s = seconds_of(log.frame.t_ns)
        for name, compared in self._actuators.items():
            compared.take(log.heard.get(name), log.verdicts.get(name), t_s)
        for name in log.heard_breaches:
            before = self._breaches.get(name)
            self._breaches[name] = ControllerBreach(
                contract=name,
                frames=1 if before is None else before.frames + 1,
                first_k=log.tick.k if before is None else before.first_k,
                first_s=t_s if before is None else before.first_s,
                last_s=t_s,
            )

    def close(self) -> None:
        """Do nothing: the counts stay."""

    def report(self) -> ControllerReport:
        """Return the report on the frames so far."""
        return ControllerReport(
            actuators=tuple(c.report(self._topics[name]) for name, c in self._actuators.items()),
            breaches=tuple(self._breaches[name] for name in self._contracts if name in self._breaches),
            held=tuple(n for n in self._contracts if n not in self._breaches and n not in self._unjudged),
            unjudged=dict(self._unjudged),
        )


class _Differences:
    """The differences of a field, of which at most `MAX_KEPT` are kept, evenly. Mutable."""

    def __init__(self) -> None:
        self._kept = array("d")
        self._every, self._count = 1, 0
        self.worst, self.worst_s = 0.0, 0.0

    def add(self, difference: float, t_s: float) -> None:
        if not self._count or difference > self.worst:
            self.worst, self.worst_s = difference, t_s
        if self._count % self._every == 0:
            self._kept.append(difference)
        self._count += 1
        if len(self._kept) > MAX_KEPT:
            self._kept, self._every = self._kept[::2], 2 * self._every

    def median(self) -> float:
        return median(self._kept)


@dataclass(frozen=False, slots=True, kw_only=True)
class _Module:
    """The counts of a module."""

    frames: int = 0
    same: int = 0
    fields: dict[str, _Differences] = field(default_factory=dict)


class _Compared:
    """The comparison of one actuator. Mutable."""

    def __init__(self, actuator: Actuator, modules: Iterable[str], tolerance: float) -> None:
        self._actuator = actuator
        self._tolerances = tuple(_tolerance(f, tolerance) for f in actuator.fields)
        self._relative = tolerance / 100.0
        self._modules: dict[str | None, _Module] = {module: _Module() for module in (*modules, None)}
        self._silent = 0

    def take(self, heard: HeardCommand | None, verdict: Verdict | None, t_s: float) -> None:
        if heard is None:
            self._silent += 1
            return
        if verdict is None:
            return
        counts = self._modules.setdefault(verdict.by, _Module())
        counts.frames += 1
        if verdict.values is None:
            return
        is_same = True
        each = zip(self._actuator.fields, self._tolerances, verdict.values, heard.values, strict=True)
        for f, tolerance, ours, theirs in each:
            difference = _difference(f, ours, theirs)
            counts.fields.setdefault(f.name, _Differences()).add(difference, t_s)
            allowed = self._relative * max(abs(ours), abs(theirs)) if tolerance is None else tolerance
            is_same = is_same and difference <= allowed
        counts.same += is_same

    def report(self, topic: str) -> ActuatorComparison:
        fields = self._actuator.fields
        units = {f.name: f.unit for f in fields}
        modules = tuple(
            ModuleComparison(
                module=module,
                frames=counts.frames,
                same=counts.same,
                fields=tuple(
                    FieldDifference(
                        field=name, unit=units[name], median=d.median(), worst=d.worst, worst_s=d.worst_s
                    )
                    for name, d in counts.fields.items()
                ),
            )
            for module, counts in self._modules.items()
        )
        return ActuatorComparison(
            actuator=self._actuator.name,
            topic=topic,
            frames=sum(m.frames for m in modules),
            silent=self._silent,
            same=sum(m.same for m in modules),
            tolerance={
                f.name: t for f, t in zip(fields, self._tolerances, strict=True) if t is not None and t > 0.0
            },
            modules=modules,
        )


def _tolerance(field: ActuatorField, percent: float) -> float | None:
    """Return the tolerance of a field in its declared unit; None if it depends on the values."""
    if not isinstance(field.type, Quantity):
        return 0.0
    if field.low is None or field.high is None:
        return None
    return percent / 100.0 * (field.high - field.low) / field.factor


def _difference(field: ActuatorField, ours: ScalarValue, theirs: ScalarValue) -> float:
    """Return how far a value is off; 1 for another member of an enum, or another bool."""
    return abs(ours - theirs) if isinstance(field.type, Quantity) else float(ours != theirs)


# --- commands as text ---------------------------------------------------------------------------------------


def command_text(actuator: Actuator, values: tuple[ScalarValue, ...]) -> str:
    """Return a command in declared units as users read it: `drive(velocity = 0.1 m/s, turn = 0 rad/s)`."""
    pairs = zip(actuator.fields, values, strict=True)
    return f"{actuator.name}({', '.join(f'{field.name} = {_value(field, value)}' for field, value in pairs)})"


def heard_text(actuator: Actuator, heard: HeardCommand | None) -> str:
    """Return what another controller commanded, as users read it."""
    if heard is None:
        return f"the controller commanded no {actuator.name}"
    age_ms = heard.age_ns / 1e6
    return (
        f"the controller commanded {command_text(actuator, heard.values)}, {age_ms:.0f} ms before the frame"
    )


def _value(field: ActuatorField, value: ScalarValue) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(field.type, Enum):
        return next((name for name, number in field.type.members if number == value), f"{value:g}")
    return f"{value + 0.0:.4g} {field.unit}".rstrip()  # + 0.0: no minus before a zero


# --- report as text ------------------------------------------------------------------------------------


def render_comparison(report: ControllerReport) -> str:
    """Return the report as text for users."""
    lines = [line for actuator in report.actuators for line in _actuator_lines(actuator)]
    lines += [
        f"  contract {b.contract}: BROKEN by the controller in {counted(b.frames, 'frame')}, "
        f"first at {b.first_s:.10g} s (frame {b.first_k}), last at {b.last_s:.10g} s"
        for b in report.breaches
    ]
    lines += [f"  contract {name}: not judged, as {why}" for name, why in report.unjudged.items()]
    if report.held and any(actuator.frames for actuator in report.actuators):
        lines.append(f"  the controller held {counted(len(report.held), 'contract')} in every frame")
    return "\n".join(lines)


def _actuator_lines(actuator: ActuatorComparison) -> list[str]:
    total = actuator.frames + actuator.silent
    head = f"  the controller commanded {actuator.actuator} over {actuator.topic} in {actuator.frames} of "
    lines = [f"{head}{counted(total, 'frame')}"]
    if not actuator.frames:
        return lines
    percent = 100.0 * actuator.same / actuator.frames
    units = {f.field: f.unit for m in actuator.modules for f in m.fields}
    within = [
        f"{name} {value:.4g} {units.get(name, '')}".rstrip() for name, value in actuator.tolerance.items()
    ]
    text = f"  the program would have sent the same in {actuator.same} of them ({percent:.1f} %)"
    lines.append(f"{text}, within {', '.join(within)}" if within else text)
    rows = [("would command", "frames", "same", "field", "off by", "at most")]
    for module in actuator.modules:
        if not module.frames:
            continue
        cells = [module.module or "(nobody)", str(module.frames), str(module.same)]
        fields = [
            (f.field, f"{f.median:.4g} {f.unit}".rstrip(), f"{f.worst:.4g} {f.unit} at {f.worst_s:.10g} s")
            for f in module.fields
        ]
        for i, (name, typical, worst) in enumerate(fields or [("", "", "")]):
            rows.append((*(cells if i == 0 else ["", "", ""]), name, typical, worst))  # type: ignore[arg-type]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        cells = [
            f"{cell:>{w}}" if i in (1, 2) else f"{cell:<{w}}"
            for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append(f"    {'  '.join(cells)}".rstrip())
    return lines
