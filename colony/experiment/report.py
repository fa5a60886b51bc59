"""The results of an experiment as numbers, and these numbers as text."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass

import numpy as np

from colony.experiment.design import Experiment
from colony.experiment.trial import STUCK_S, TrialResult
from colony.text.wording import counted

# --- statistics ---------------------------------------------------------------------------------------
#
# Proportions and means with 95 % intervals.

Z = 1.959963984540054
"""The 97.5 % quantile of the normal distribution."""

RESAMPLES = 2000
"""Resamples of a bootstrap."""


@dataclass(frozen=True, slots=True)
class Proportion:
    """`cases` of `total`, and the interval of the probability."""

    cases: int
    total: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """The observed proportion."""
        return self.cases / self.total if self.total else 0.0


@dataclass(frozen=True, slots=True)
class Mean:
    """A mean with its interval, and the least and greatest value."""

    mean: float
    low: float
    high: float
    least: float
    greatest: float


def wilson(cases: int, total: int) -> Proportion:
    """Return a proportion with its score interval (Wilson 1927), which holds for rare events, too."""
    if not total:
        return Proportion(cases, total, 0.0, 1.0)
    share, spread = cases / total, Z * Z / total
    middle = (share + spread / 2.0) / (1.0 + spread)
    half = Z / (1.0 + spread) * math.sqrt(share * (1.0 - share) / total + spread / (4.0 * total))
    return Proportion(
        cases, total, 0.0 if not cases else middle - half, 1.0 if cases == total else middle + half
    )


def mean_of(values: Sequence[float]) -> Mean:
    """Return a mean with its percentile bootstrap interval, the same for the same values.

    Args:
        values: at least one number.
    """
    array = np.array(values, dtype=np.float64)
    rng = np.random.default_rng(len(array))
    means = [array[rng.integers(0, len(array), len(array))].mean() for _ in range(RESAMPLES)]
    low, high = np.quantile(means, (0.025, 0.975)).tolist()
    return Mean(float(array.mean()), low, high, float(array.min()), float(array.max()))


# --- report -------------------------------------------------------------------------------------------

BINS = 4
"""The number of bins into which the range of a param is divided."""

WORST = 5
"""The number of runs named as the worst ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """The results of one behavior.

    Attributes:
        label: the name of the behavior.
        contacts: the runs with a contact.
        contacts_per_run: the number of contacts of a run.
        stuck: the runs in which the robot was stuck; None if no run was long enough.
        broken: the runs in which a contract was broken, by contract.
        assumptions: the runs in which an assumption was broken, by assumption.
        assumption_frames: the part of the frames that broke it, by assumption.
        unmet: the part of the frames that broke any assumption.
        unexplained: the number of contacts near which none was broken; None if the program assumes nothing.
        off_map: the runs in which the robot left the known cells of the map.
        arrived: the runs that arrived at their goal; None if there was none.
        distance_m: the distance of a run.
        duration_s: the duration of a run.
        blind: the part of the frames in which a needed sensor had no value, 0 to 1.
        shares: the part of the frames in which each module commanded, by `actuator/module`.
        limits: the part of the frames in which a limit cut a command, by `actuator.field`.
        remarks: what devices and modules reported, with the number of runs.
        worst: numbers of the runs that a reader looks at first.
        audited: the number of audited runs.
        differences: the differences from the reference interpreter.
    """

    label: str
    contacts: Proportion
    contacts_per_run: Mean
    stuck: Proportion | None
    broken: dict[str, Proportion]
    assumptions: dict[str, Proportion]
    assumption_frames: dict[str, float]
    unmet: float
    unexplained: int | None
    off_map: Proportion
    arrived: Proportion | None
    distance_m: Mean
    duration_s: Mean
    blind: float
    shares: dict[str, float]
    limits: dict[str, float]
    remarks: dict[str, int]
    worst: tuple[int, ...]
    audited: int
    differences: tuple[str, ...]

    @property
    def failed(self) -> bool:
        """True if a contract was broken, or the interpreter decided differently."""
        return bool(self.broken or self.differences)


def summary_of(label: str, results: Sequence[TrialResult]) -> Summary:
    """Return the summary of at least one result of a behavior."""
    frames = sum(r.frames for r in results) or 1
    broken = Counter(name for r in results for name in r.breaches)
    assumptions = Counter(name for r in results for name in r.assumptions)
    worst = sorted(filter(_badness, results), key=_badness, reverse=True)[:WORST]
    return Summary(
        label=label,
        contacts=_proportion(results, lambda r: r.contacts > 0),
        contacts_per_run=mean_of([r.contacts for r in results]),
        stuck=_stuck(results),
        broken={name: wilson(count, len(results)) for name, count in sorted(broken.items())},
        assumptions={name: wilson(count, len(results)) for name, count in sorted(assumptions.items())},
        assumption_frames={
            name: sum(r.assumptions.get(name, 0) for r in results) / frames for name in sorted(assumptions)
        },
        unmet=sum(r.unmet for r in results) / frames,
        unexplained=sum(r.unexplained for r in results) if results[0].unexplained >= 0 else None,
        off_map=_proportion(results, lambda r: r.off_map_s > 0.0),
        arrived=_proportion(results, lambda r: r.arrived == 1) if results[0].arrived >= 0 else None,
        distance_m=mean_of([r.distance_mm / 1000.0 for r in results]),
        duration_s=mean_of([r.duration_s for r in results]),
        blind=sum(r.blind for r in results) / frames,
        shares=_mean_parts(results, frames),
        limits={
            name: count / frames
            for name, count in sorted(sum((Counter(r.limits) for r in results), Counter[str]()).items())
        },
        remarks=dict(Counter(r.remark for r in results if r.remark).most_common(WORST)),
        worst=tuple(r.key.number for r in worst),
        audited=sum(r.audited > 0 for r in results),
        differences=tuple(f"run {r.key.number}: {r.difference}" for r in results if r.difference),
    )


def _mean_parts(results: Sequence[TrialResult], frames: int) -> dict[str, float]:
    names = list(dict.fromkeys(name for r in results for name in r.shares))
    return {name: sum(r.shares.get(name, 0.0) * r.frames for r in results) / frames for name in names}


def _stuck(results: Sequence[TrialResult]) -> Proportion | None:
    is_measured = any(r.duration_s > STUCK_S for r in results)
    return _proportion(results, lambda r: r.is_stuck) if is_measured else None


def _proportion(results: Sequence[TrialResult], has: Callable[[TrialResult], bool]) -> Proportion:
    return wilson(sum(map(has, results)), len(results))


def _badness(result: TrialResult) -> tuple[int, ...]:
    """Return a key that is larger for worse runs, and () for good ones."""
    bad = (
        bool(result.difference),
        len(result.breaches),
        result.contacts,
        result.is_stuck,
        result.arrived == 0,
    )
    return tuple(map(int, bad)) if any(bad) else ()


# --- text ----------------------------------------------------------------------------------------


def text_of(experiment: Experiment, results: Sequence[TrialResult]) -> str:
    """Return the results as text for users: a summary of each behavior, params, and their differences."""
    parts = []
    for program in experiment.programs:
        own = [r for r in results if r.key.variant == program.label]
        if own:
            parts += [
                _summary_text(experiment, summary_of(program.label, own), len(own)),
                *_by_param(experiment, own),
            ]
    comparison = comparison_of(experiment, results)
    if comparison is not None:
        parts.append(_comparison_text(comparison))
    return "\n\n".join(parts)


def _summary_text(experiment: Experiment, summary: Summary, runs: int) -> str:
    rows = list(_rows(summary))
    width = max(len(name) for name, _ in rows)
    head = f"{summary.label} {experiment.name}: {counted(runs, 'run')}"
    return "\n".join([head, *(f"  {name:<{width}}  {value}".rstrip() for name, value in rows)])


def _rows(summary: Summary) -> Iterator[tuple[str, str]]:
    if summary.arrived is not None:
        yield "arrived", proportion_text(summary.arrived)
    yield "with a contact", proportion_text(summary.contacts)
    if summary.contacts.cases:
        yield "contacts of a run", mean_text(summary.contacts_per_run, 2)
    not_measured = f"not measured: no run lasts {STUCK_S:.0f} s"
    yield "stuck", not_measured if summary.stuck is None else proportion_text(summary.stuck)
    if summary.off_map.cases:
        yield "off the map", proportion_text(summary.off_map)
    yield from _breaches(summary)
    yield "distance of a run in m", mean_text(summary.distance_m, 2)
    if summary.duration_s.least != summary.duration_s.greatest:
        yield "duration of a run in s", mean_text(summary.duration_s, 1)
    yield "blind", f"{100.0 * summary.blind:.2f} % of the frames"
    for name, share in summary.limits.items():
        yield f"limited {name}", f"{100.0 * share:.2f} % of the frames"
    idle = {name.partition("/")[0] for name, share in summary.shares.items() if share == 1.0}
    for name, share in summary.shares.items():
        if name.partition("/")[0] in idle:
            continue
        yield name, f"{100.0 * share:5.1f} % of the frames"
    for remark, count in summary.remarks.items():
        yield "reported", f"in {counted(count, 'run')}: {remark}"
    if summary.audited:
        found = f"{len(summary.differences)} DIFFER" if summary.differences else "all decided the same"
        yield "audited", f"{counted(summary.audited, 'run')}: {found}"
    for difference in summary.differences[:WORST]:
        yield "DIFFERS", difference
    if summary.worst:
        yield "look at", f"--replay {', '.join(map(str, summary.worst))}"


def proportion_text(found: Proportion) -> str:
    """Return a proportion as text: `37 of 1000 (2.7 to 5.1 %)`."""
    runs = counted(found.total, "run")
    return f"{found.cases} of {runs} ({100.0 * found.low:.1f} to {100.0 * found.high:.1f} %)"


def mean_text(found: Mean, digits: int) -> str:
    """Return a mean as text, with its interval and the range of the values."""
    mean, low, high, least, greatest = (f"{value:.{digits}f}" for value in astuple(found))
    return f"{mean} ({low} to {high}; {least} to {greatest} in single runs)"


def _by_param(experiment: Experiment, results: Sequence[TrialResult]) -> Iterator[str]:
    """Yield a table for each param, with a row for each part of its range."""
    for name, values in experiment.params:
        step = (values.high - values.low) / BINS
        bins: dict[int, list[TrialResult]] = {}
        for r in results:
            bins.setdefault(min(int((r.params[name] - values.low) / step), BINS - 1), []).append(r)
        unit = f" {values.unit}" if values.unit else ""
        lines = [f"  by {name}:"]
        for number, own in sorted(bins.items()):
            low, high = values.low + number * step, values.low + (number + 1) * step
            contacts = _proportion(own, lambda r: r.contacts > 0)
            stuck, distance = _stuck(own), mean_of([r.distance_mm / 1000.0 for r in own])
            figures = [f"with a contact {proportion_text(contacts)}"]
            figures += [] if stuck is None else [f"stuck {proportion_text(stuck)}"]
            for contract in sorted({contract for r in results for contract in r.breaches}):
                broken = wilson(sum(contract in r.breaches for r in own), len(own))
                figures.append(f"{contract} broken {proportion_text(broken)}")
            lines.append(f"    {low:.4g} to {high:.4g}{unit}: {', '.join(figures)}, {distance.mean:.2f} m")
        yield "\n".join(lines)


def _breaches(summary: Summary) -> Iterator[tuple[str, str]]:
    for name, broken in summary.broken.items():
        yield f"contract {name}", f"BROKEN in {proportion_text(broken)}"
    for name, broken in summary.assumptions.items():
        frames = f"{100.0 * summary.assumption_frames[name]:.2f} % of the frames"
        yield f"assumption {name}", f"broken in {proportion_text(broken)}, {frames}"
    if summary.unexplained is not None:
        yield "assumptions broken", f"in {100.0 * summary.unmet:.2f} % of the frames"
        yield "contacts without a broken assumption", str(summary.unexplained)
    if not summary.broken:
        yield "contracts", "held in every frame"


# --- comparison ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedDifference:
    """The paired differences of one measure, second behavior minus first, over the runs of both.

    Attributes:
        measure: the measure.
        difference: the mean of the differences.
        more, less, same: the number of runs in which the second behavior has more, less, or the same.
    """

    measure: str
    difference: Mean
    more: int
    less: int
    same: int


_MEASURES: tuple[tuple[str, Callable[[TrialResult], float]], ...] = (
    ("contacts", lambda r: float(r.contacts)),
    ("stuck", lambda r: float(r.is_stuck)),
    ("arrived", lambda r: float(r.arrived)),
    ("broken contracts", lambda r: float(len(r.breaches))),
    ("distance in m", lambda r: r.distance_mm / 1000.0),
    ("duration in s", lambda r: r.duration_s),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedComparison:
    """The comparison of two behaviors over `pairs` runs with the same inputs."""

    first: str
    second: str
    pairs: int
    differences: tuple[PairedDifference, ...]


def comparison_of(experiment: Experiment, results: Sequence[TrialResult]) -> PairedComparison | None:
    """Return the comparison of an experiment's two behaviors; None if there are not two, or no pairs yet."""
    if len(experiment.programs) < 2:
        return None
    first, second = (
        {r.key.number: r for r in results if r.key.variant == program.label}
        for program in experiment.programs
    )
    pairs = [(first[number], second[number]) for number in sorted(first.keys() & second.keys())]
    if not pairs:
        return None
    found = []
    for measure, value in _MEASURES:
        deltas = [value(b) - value(a) for a, b in pairs]
        if any(deltas):
            more, less = sum(d > 0.0 for d in deltas), sum(d < 0.0 for d in deltas)
            found.append(
                PairedDifference(
                    measure=measure,
                    difference=mean_of(deltas),
                    more=more,
                    less=less,
                    same=len(deltas) - more - less,
                )
            )
    names = [program.label for program in experiment.programs]
    return PairedComparison(first=names[0], second=names[1], pairs=len(pairs), differences=tuple(found))


def _comparison_text(found: PairedComparison) -> str:
    head = f"{found.second} minus {found.first}, {counted(found.pairs, 'pair')} of runs with the same inputs:"
    if not found.differences:
        return f"{head} no difference"
    width = max(len(d.measure) for d in found.differences)
    lines = [head]
    for d in found.differences:
        mean, low, high = (f"{value:+.3g}" for value in astuple(d.difference)[:3])
        runs = f"more in {d.more} runs, less in {d.less}, the same in {d.same}"
        certain = "" if d.difference.low > 0.0 or d.difference.high < 0.0 else "; no clear difference"
        lines.append(f"  {d.measure:<{width}}  {mean} ({low} to {high}); {runs}{certain}")
    return "\n".join(lines)
