"""Summary of a run as data and as text: time in command, bumps, broken contracts, and so on."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from typing import assert_never

from colony.execute.compiled import Compiled
from colony.execute.needs import BOUNDS
from colony.ir.frame import RecordKind
from colony.ir.site import Site
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Fate, Hold
from colony.runtime.protocol.topics import client_address
from colony.text.wording import counted, printable, quoted, seconds_of

SHADOW_TEXT = "SHADOW: this is what it would have sent; it commanded nothing"
"""Line about a program in the shadow of a robot."""


OUTSIDE = "(outside)"
"""Stands for the connections from outside the network that commanded, in the place of a module."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """The frames and seconds in which `module` commanded, nobody did (None), or a connection (`OUTSIDE`)."""

    module: str | None
    frames: int
    seconds: float
    percent: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Unheard:
    """The frames and seconds in which no verdict of `server` arrived: it was down, or was not heard."""

    server: str
    frames: int
    seconds: float
    percent: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorSummary:
    """Shares of every client, in descending order of priority, and last the share of idle frames.

    `unheard` are the frames without a verdict; None if there were none.
    """

    actuator: str
    shares: tuple[Share, ...]
    unheard: Unheard | None


@dataclass(frozen=True, slots=True, kw_only=True)
class BreachSummary:
    """A contract that was broken in `frames` frames, and the times of the first and last of these.

    One that is `assumed` is an assumption about the world, not a failure of the program.
    """

    contract: str
    frames: int
    first_s: float
    last_s: float
    assumed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordSummary:
    """A kind of record (`colony.ir.frame.RecordKind`) about `subject`, in `frames` frames."""

    kind: RecordKind
    subject: str
    frames: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TroubleSummary:
    """A client that was late, lost, refused or overruled in `frames` frames.

    `client` is its module; for the client of an actuator's bounds, its address.
    """

    client: str
    fate: Fate
    frames: int


@dataclass(frozen=True, slots=True, kw_only=True)
class InterventionSummary:
    """An intervention at `actuator`, because of which the network did not decide in `frames` frames.

    Either the connection `by` commanded from outside the network, or `hold` was in force. In `unlimited` of
    the frames the limits of the program did not hold for the connection.
    """

    actuator: str
    by: str | None
    hold: Hold | None
    frames: int
    unlimited: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class OffMap:
    """A simulated robot's way off the known cells of a grid.

    It has the times when the robot first left these cells and the image (None if it stayed in the image), and
    the seconds that it spent off the known cells.
    """

    left_known_s: float
    left_image_s: float | None
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Travel:
    """Travel of a robot: the number of times that it bumped into something, and the length of its path.

    `off_map` is None if it stayed on the known cells of a grid, or its map is no grid.
    """

    bumps: int
    distance_mm: float
    off_map: OffMap | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherSummary:
    """Travel of another robot of a simulated world: its name, the kind of `robot` it is, its behavior.

    `unread` are the sensors of its program that never had a value.
    """

    name: str
    robot: str
    behavior: str
    bumps: int
    distance_mm: float
    unread: tuple[str, ...] = ()
    off_map: OffMap | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ParamsSummary:
    """The params that a site set in `file`, and their hash; `proved` is False for a run without a proof."""

    file: str
    hash: str
    proved: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSummary:
    """Summary of one run; `contracts` is the number of contracts of the program, without its assumptions.

    `broke_off` is the reason why the run ended early, although no user interrupted it. `unwritten` are files
    that could not be written after the run.

    `restarts` counts the restarts of all memory, `skipped` the frames that could not be observed, and
    `unknown` the frames that could not be checked because memory was unknown. On a real robot the travel is
    unknown: `bumps`, `distance_mm`, `mean_speed_mm_s` and `off_map` are None. `params` is None if no site set
    any. `others` are the other robots of a simulated world. `driver_failures` has a line for each server of a
    real robot whose driver failed. `shadow` is True if the program ran in the shadow of a robot: it commanded
    nothing, and all else is what it would have done. `unread` are the sensors that never had a value.
    """

    robot: str
    seed: int
    frames: int
    duration_s: float
    interrupted: bool
    bumps: int | None
    distance_mm: float | None
    mean_speed_mm_s: float | None
    actuators: tuple[ActuatorSummary, ...]
    contracts: int
    breaches: tuple[BreachSummary, ...]
    records: tuple[RecordSummary, ...]
    troubles: tuple[TroubleSummary, ...]
    interventions: tuple[InterventionSummary, ...]
    restarts: int
    skipped: int
    disagreements: tuple[str, ...]
    broke_off: str | None = None
    unwritten: tuple[str, ...] = ()
    unknown: int = 0
    params: ParamsSummary | None = None
    others: tuple[OtherSummary, ...] = ()
    driver_failures: tuple[str, ...] = ()
    shadow: bool = False
    off_map: OffMap | None = None
    unread: tuple[str, ...] = ()

    def as_json(self) -> dict[str, object]:
        """Return the summary as plain dicts and lists."""
        return asdict(self)

    @property
    def succeeded(self) -> bool:
        """True if no contract was broken, the runtime followed the program, and the run did not break off."""
        return not self.broken_contracts and not self.disagreements and self.broke_off is None

    @property
    def broken_contracts(self) -> tuple[BreachSummary, ...]:
        """The breaches without those of assumptions."""
        return tuple(b for b in self.breaches if not b.assumed)


def breach_text(name: str, *, assumed: bool) -> str:
    """Return that a contract was BROKEN, or an assumption broken."""
    return f"assumption {name}: broken" if assumed else f"contract {name}: BROKEN"


_REPORTED_FATES: tuple[Fate, ...] = ("late", "lost", "refused", "overruled")
_MAX_DISAGREEMENTS = 10


class Tally:
    """A sink that counts frames for a summary. Mutable."""

    def __init__(self, compiled: Compiled) -> None:
        self._compiled = compiled
        self._clients_by_actuator = compiled.clients_by_actuator
        self._commanded: dict[str, Counter[str | None]] = {a: Counter() for a in self._clients_by_actuator}
        self._records: Counter[tuple[RecordKind, str]] = Counter()
        self._troubles: Counter[tuple[str, Fate]] = Counter()
        self._interventions: Counter[tuple[str, str | None, Hold | None]] = Counter()
        self._unlimited: Counter[tuple[str, str | None, Hold | None]] = Counter()
        self._breaches: dict[str, BreachSummary] = {}
        self._assumed = {c.name for c in compiled.contracts if c.assumed}
        self._disagreements: list[str] = []
        self.frames = 0
        self._restarts = 0
        self._skipped = self._unknown = 0

    def take(self, log: RunFrame) -> None:
        """Count a frame."""
        self.frames += 1
        self._restarts += log.restart
        self._skipped += log.skipped
        self._unknown += log.memory_unknown
        for name, verdict in log.verdicts.items():
            is_outside = verdict.by is None and verdict.outside is not None
            self._commanded[name][OUTSIDE if is_outside else verdict.by] += 1
            if verdict.outside is not None or verdict.hold is not None:
                self._interventions[name, verdict.outside, verdict.hold] += 1
                self._unlimited[name, verdict.outside, verdict.hold] += verdict.unlimited
            for client, fate in verdict.fates:
                if fate in _REPORTED_FATES:
                    self._troubles[client_address(name, BOUNDS) if client == BOUNDS else client, fate] += 1
        self._records.update((r.kind, r.subject) for r in log.expected.records)
        t = seconds_of(log.frame.t_ns)
        for contract in log.expected.breaches:
            previous = self._breaches.get(contract)
            self._breaches[contract] = BreachSummary(
                contract=contract,
                frames=previous.frames + 1 if previous else 1,
                first_s=previous.first_s if previous else t,
                last_s=t,
                assumed=contract in self._assumed,
            )
        if log.disagreements and len(self._disagreements) < _MAX_DISAGREEMENTS:
            self._disagreements.extend(f"at {t:.10g} s, {text}" for text in log.disagreements)

    def close(self) -> None:
        """Do nothing: the counts stay."""

    def summary(
        self, *, seed: int, duration_s: float, interrupted: bool, travel: Travel | None
    ) -> RunSummary:
        """Return the summary of the frames so far."""
        return RunSummary(
            robot=self._compiled.name,
            seed=seed,
            frames=self.frames,
            duration_s=duration_s,
            interrupted=interrupted,
            bumps=None if travel is None else travel.bumps,
            distance_mm=None if travel is None else travel.distance_mm,
            mean_speed_mm_s=None if travel is None else _mean_speed(travel.distance_mm, duration_s),
            actuators=tuple(self._actuator(a) for a in self._clients_by_actuator),
            contracts=len(self._compiled.contracts) - len(self._assumed),
            breaches=tuple(self._breaches.values()),
            records=tuple(
                RecordSummary(kind=kind, subject=subject, frames=n)
                for (kind, subject), n in self._records.items()
            ),
            troubles=tuple(
                TroubleSummary(client=client, fate=fate, frames=n)
                for (client, fate), n in self._troubles.items()
            ),
            interventions=tuple(
                InterventionSummary(
                    actuator=actuator,
                    by=by,
                    hold=hold,
                    frames=n,
                    unlimited=self._unlimited[actuator, by, hold],
                )
                for (actuator, by, hold), n in self._interventions.items()
            ),
            restarts=self._restarts,
            skipped=self._skipped,
            disagreements=tuple(self._disagreements),
            unknown=self._unknown,
            params=_params(self._compiled.site),
            off_map=None if travel is None else travel.off_map,
        )

    def _actuator(self, name: str) -> ActuatorSummary:
        counts = self._commanded[name]
        period_s = self._compiled.frame_ns / 1e9
        rows: list[str | None] = [*self._clients_by_actuator[name], None]
        rows += [OUTSIDE] if counts[OUTSIDE] else []
        return ActuatorSummary(
            actuator=name,
            unheard=self._unheard(name, self.frames - counts.total()),
            shares=tuple(
                Share(
                    module=module,
                    frames=counts[module],
                    seconds=counts[module] * period_s,
                    percent=100.0 * counts[module] / self.frames if self.frames else 0.0,
                )
                for module in rows
            ),
        )

    def _unheard(self, actuator: str, frames: int) -> Unheard | None:
        if not frames:
            return None
        return Unheard(
            server=next(a.server for a in self._compiled.robot.actuators if a.name == actuator),
            frames=frames,
            seconds=frames * self._compiled.frame_ns / 1e9,
            percent=100.0 * frames / self.frames,
        )


def _params(site: Site | None) -> ParamsSummary | None:
    if site is None:
        return None
    return ParamsSummary(file=site.file, hash=site.hash, proved=site.proved is not None)


def _mean_speed(distance_mm: float, duration_s: float) -> float:
    return distance_mm / duration_s if duration_s > 0 else 0.0


def render(summary: RunSummary) -> str:
    """Return the summary as text for users."""
    end = ", interrupted" if summary.interrupted else ", broken off" if summary.broke_off else ""
    length = f"{summary.duration_s:.1f} s, {counted(summary.frames, 'frame')}"
    head = f"{summary.robot}: {length}, seed {summary.seed}{end}"
    lines = [head]
    if summary.shadow:
        lines.append(f"  {SHADOW_TEXT}")
    if summary.params is not None:
        proved = "" if summary.params.proved else ", UNPROVED"
        lines.append(f"  with the params of {summary.params.file} ({summary.params.hash[:12]}){proved}")
    for actuator in summary.actuators:
        commanded = "would have been commanded" if summary.shadow else "was commanded"
        lines += [f"  {actuator.actuator} {commanded} by", *_shares(actuator)]
    if summary.distance_mm is not None and summary.mean_speed_mm_s is not None:
        lines.append(
            f"  traveled {summary.distance_mm / 1000:.2f} m "
            f"at {summary.mean_speed_mm_s:.0f} mm/s on average, {counted(summary.bumps or 0, 'bump')}"
        )
    lines += [f"  {_off_map(summary.off_map)}"] if summary.off_map is not None else []
    lines += map(_other_line, summary.others)
    lines += [f"  {r.subject}: {r.kind} in {counted(r.frames, 'frame')}" for r in summary.records]
    lines += [f"  client {t.client}: {t.fate} in {counted(t.frames, 'frame')}" for t in summary.troubles]
    lines += [
        f"  {i.actuator}: {_describe(i)} in {counted(i.frames, 'frame')}{_ignored_limits(i)}"
        for i in summary.interventions
    ]
    lines += [f"  {printable(failure)}" for failure in summary.driver_failures]
    lines += [f"  {quoted(summary.unread)} never had a value"] if summary.unread else []
    if summary.restarts:
        lines.append(f"  all memory restarted {counted(summary.restarts, 'time')}")
    if summary.skipped:
        lines.append(f"  {counted(summary.skipped, 'frame')} could not be observed")
    if summary.unknown:
        lines.append(f"  {counted(summary.unknown, 'frame')} not checked: memory was unknown")
    lines += [
        f"  {breach_text(b.contract, assumed=b.assumed)} in {counted(b.frames, 'frame')}, "
        f"first at {b.first_s:.10g} s, last at {b.last_s:.10g} s"
        for b in summary.breaches
    ]
    if summary.contracts and summary.frames and not (summary.broken_contracts or summary.unknown):
        lines.append(f"  {counted(summary.contracts, 'contract')} held in every frame")
    lines += [f"  INTERNAL: {text}" for text in summary.disagreements]
    lines += [] if summary.broke_off is None else [f"  {summary.broke_off}"]
    return "\n".join(lines)


def _other_line(other: OtherSummary) -> str:
    way = f"{other.distance_mm / 1000:.2f} m, {counted(other.bumps, 'bump')}"
    unread = f"; {quoted(other.unread)} never had a value" if other.unread else ""
    left = "" if other.off_map is None else f"; {_off_map(other.off_map)}"
    return f"  {other.name} ({other.robot} with {other.behavior}) traveled {way}{unread}{left}"


def _off_map(off: OffMap) -> str:
    image = "" if off.left_image_s is None else f" and the image at {off.left_image_s:.2f} s"
    return f"left the known cells of the map at {off.left_known_s:.2f} s{image}; {off.seconds:.2f} s off them"


def _shares(actuator: ActuatorSummary) -> list[str]:
    rows = [(share.module or "(nobody)", share.seconds, share.percent) for share in actuator.shares]
    if actuator.unheard is not None:
        unheard = actuator.unheard
        rows.append((f"(no verdict of {unheard.server})", unheard.seconds, unheard.percent))
    width = max(len(name) for name, _, _ in rows)
    return [f"    {name:<{width}}  {seconds:7.2f} s  {percent:5.1f} %" for name, seconds, percent in rows]


def _ignored_limits(intervention: InterventionSummary) -> str:
    return f" ({intervention.unlimited} of them ignored the limits)" if intervention.unlimited else ""


def _describe(intervention: InterventionSummary) -> str:
    match intervention.hold:
        case None:
            return f"{intervention.by} commanded from outside the network"
        case "stopped":
            return "the EMERGENCY STOP was on (`colony stop --release` ends it)"
        case "locked" if intervention.by is not None:
            return f"{intervention.by}, which holds the lock, commanded"
        case "locked":
            return "a connection outside the network held the lock"
        case _ as never:
            assert_never(never)
