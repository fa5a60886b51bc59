"""A run of an experiment, from its design to its result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NoReturn

from colony.analysis.audit import audit_recording
from colony.analysis.recording import OpenRecording
from colony.execute.compiled import Compiled
from colony.execute.needs import sensors_without_default
from colony.experiment.design import Trial, compiled_of
from colony.experiment.results import KEY_COLUMNS, Points, ResultTable, RunKey
from colony.ir.program import Program
from colony.runs.building_run import run_in_building
from colony.runs.spec import MisuseError, RunReport, UserInterface
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.observer import Sink
from colony.text.diagnostics import DiagnosticError

STUCK_S = 30.0
"""A robot that stays in place for this many seconds is stuck (see `LongestStay`)."""

BEFORE_S, FELT_S = 2.0, 0.5
"""Seconds before a contact in which a broken assumption counts, and seconds until the contact is felt."""

PATH_SPACING = 25
"""Every so many points of a path are kept in results."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialResult:
    """The result of one run.

    Attributes:
        key: the key of the run.
        movers: the number of people.
        params: the drawn values of params, in the units of their ranges.
        frames, duration_s: the length of the run.
        contacts: the number of times that the robot touched something.
        distance_mm: the length of its path.
        stay_s: its longest stay in one place.
        off_map_s: the seconds that it spent off the known cells of a grid.
        arrived: 1 if the robot arrived at its goal, 0 if it did not, -1 if it had none.
        blind: the number of frames in which a sensor that the program needs had no value.
        shares: the part of the frames in which each module commanded, by `actuator/module`.
        limits: the number of frames in which a limit cut a command, by `actuator.field`.
        breaches: the time in s at which a contract was broken first, by contract.
        assumptions: the number of frames that broke an assumption of the program, by assumption.
        unmet: the number of frames that broke any of them.
        unexplained: the number of contacts near which no frame broke one (`BEFORE_S`, `FELT_S`);
            -1 without assumptions.
        remark: the first report of a device or module, or a difference between the runtime and the program.
        difference: the first frame that the reference interpreter decided differently; "" for none.
        audited: the number of frames that the reference interpreter decided.
        path: the true path, x and y in mm.
        places: the place of the robot at each contact.
    """

    key: RunKey
    movers: int
    params: Mapping[str, float]
    frames: int
    duration_s: float
    contacts: int
    distance_mm: float
    stay_s: float
    off_map_s: float
    arrived: int
    blind: int
    shares: Mapping[str, float]
    limits: Mapping[str, int]
    breaches: Mapping[str, float]
    assumptions: Mapping[str, int]
    unmet: int
    unexplained: int
    remark: str
    difference: str
    audited: int
    path: Points
    places: Points

    @property
    def is_stuck(self) -> bool:
        """True if the robot made no progress for `STUCK_S`, and did not wait at its goal."""
        return self.stay_s >= STUCK_S and self.arrived != 1


TRIALS = ResultTable(
    name="trial",
    kind=TrialResult,
    columns=(
        *KEY_COLUMNS,
        *("movers", "params", "frames", "duration_s", "contacts", "distance_mm", "stay_s", "off_map_s"),
        *("arrived", "blind", "shares", "limits", "breaches", "assumptions"),
        *("unmet", "unexplained", "remark"),
        *("difference", "audited"),
        *("path", "places"),
    ),
)
"""The table of these results."""


class TrialError(Exception):
    """A run cannot be made; the message has its number and the reason."""


def run_trial(trial: Trial, record: str | None = None) -> TrialResult:
    """Run a trial; the result depends on it alone.

    Args:
        trial: the trial.
        record: the file of a recording, which `colony watch` and `colony explain` read.

    Raises:
        TrialError: the program has errors, it needs something that its robot lacks, the robot does not fit at
            its start, or the recording cannot be written.
    """
    try:
        if trial.audited and record is None:
            with TemporaryDirectory(prefix="colony-experiment-") as folder:
                return _run(trial, str(Path(folder, "run.mcap")))
        return _run(trial, record)
    except (DiagnosticError, MisuseError) as problem:
        raise TrialError(f"run {trial.key.number}: {problem}") from None


def _run(trial: Trial, record: str | None) -> TrialResult:
    program, compiled, described = compiled_of(trial.program, trial.params)
    blindness, world, reports = _Blindness(compiled), _World(compiled), list[str]()
    spec = replace(trial.spec, record=record)
    report = run_in_building(compiled, described, spec, _interface((blindness, world), reports.append))
    difference, audited = _audit(program, record) if trial.audited and record is not None else ("", 0)
    return _result(trial, report, blindness.frames, world, reports, difference, audited)


def _result(
    trial: Trial,
    report: RunReport,
    blind: int,
    world: _World,
    reports: list[str],
    difference: str,
    audited: int,
) -> TrialResult:
    summary, mission = report.summary, report.mission_result
    path = next(iter(report.paths.values()), ())
    return TrialResult(
        key=trial.key,
        movers=trial.spec.world.movers,
        params=dict(trial.drawn),
        frames=summary.frames,
        duration_s=summary.duration_s,
        contacts=summary.bumps or 0,
        distance_mm=summary.distance_mm or 0.0,
        stay_s=report.longest_stay_s,
        off_map_s=0.0 if summary.off_map is None else summary.off_map.seconds,
        arrived=-1 if mission is None else int(mission.arrived),
        blind=blind,
        shares={
            f"{actuator.actuator}/{share.module or '(nobody)'}": share.frames / max(summary.frames, 1)
            for actuator in summary.actuators
            for share in actuator.shares
        },
        limits={r.subject: r.frames for r in summary.records if r.kind == "limited"},
        breaches={breach.contract: breach.first_s for breach in summary.broken_contracts},
        assumptions={breach.contract: breach.frames for breach in summary.breaches if breach.assumed},
        unmet=len(world.unmet_s),
        unexplained=sum(not world.broke_near(t_s) for t_s in report.contact_s) if world.assumed else -1,
        remark=next(iter([*summary.disagreements, *reports]), ""),
        difference=difference,
        audited=audited,
        path=_rounded([*path[:-1:PATH_SPACING], *path[-1:]]),
        places=_rounded(report.contacts),
    )


def _rounded(points: Iterable[tuple[float, float]]) -> Points:
    return tuple((round(x), round(y)) for x, y in points)


class _Blindness:
    """A sink that counts the frames in which a sensor that the program needs has no value. Mutable."""

    def __init__(self, compiled: Compiled) -> None:
        read = sensors_without_default(compiled.code).values()
        self._needed = frozenset(s.name for sensors in read for s in sensors)
        self.frames = 0

    def take(self, log: RunFrame) -> None:
        """Take the next frame."""
        self.frames += not self._needed <= log.frame.readings.keys()

    def close(self) -> None:
        """Do nothing: the count stays."""


class _World:
    """A sink that collects the times in s of the frames that break an assumption. Mutable."""

    def __init__(self, compiled: Compiled) -> None:
        self.assumed = frozenset(c.name for c in compiled.contracts if c.assumed)
        self.unmet_s: list[float] = []

    def take(self, log: RunFrame) -> None:
        """Take the next frame."""
        if not self.assumed.isdisjoint(log.expected.breaches):
            self.unmet_s.append(log.frame.t_ns / 1e9)

    def close(self) -> None:
        """Do nothing: the times stay."""

    def broke_near(self, contact_s: float) -> bool:
        """Return True if an assumption was broken shortly before a contact, or as it was felt."""
        return any(contact_s - BEFORE_S <= t_s <= contact_s + FELT_S for t_s in self.unmet_s)


class _NoProgress:
    """A sink that shows nothing. Stateless."""

    def take(self, log: RunFrame) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


def _interface(sinks: tuple[Sink, ...], report: Callable[[str], None]) -> UserInterface:
    @contextmanager
    def uninterrupted() -> Iterator[Callable[[], bool]]:
        yield lambda: False

    def no_operator(building: object) -> NoReturn:
        raise AssertionError("elevators are operated by the simulation")

    return UserInterface(
        report=report,
        interruptible=uninterrupted,
        progress=lambda length_ns: _NoProgress(),
        operator=no_operator,
        sinks=sinks,
    )


def _audit(program: Program, record: str) -> tuple[str, int]:
    """Return the first difference from the reference interpreter, "" for none, and the compared frames."""
    with OpenRecording.at(record) as recording:
        found = audit_recording(program, recording.reader)
    first = found.first
    difference = "" if first is None else f"frame at {first.t_ns / 1e9:.2f} s: {first.message}"
    return difference, found.compared
