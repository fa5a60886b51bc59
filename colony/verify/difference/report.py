"""The report of a comparison: lines of text, and a row for JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from colony.ir.frame import Outcome
from colony.ir.program import Program
from colony.verify.contracts.report import frame_row, locations, outcome_row, reason_text
from colony.verify.contracts.table import aligned, decision_text, missing_lines, reading_cell, seconds
from colony.verify.difference.results import DifferenceUndecided, Different, Matching, Result, Same


def lines(a: Program, b: Program, result: Result) -> Iterator[str]:
    """Yield the verdict, the run in which the behaviors differ, and the correspondence of modules."""
    match result:
        case Same(by_content=True):
            yield "the same: they differ only in names"
        case Same(k=k, over_reals=over_reals):
            how = "frame by frame" if k == 0 else f"by {k}-induction"
            over = " over reals" if over_reals else ""
            yield f"the same{over}: in every frame of every run they send the same (proved {how})"
            if over_reals:
                yield f"  floats may round at {locations(over_reals)}"
        case Different(snapshots=snapshots):
            count = "one frame" if len(snapshots) == 1 else f"{len(snapshots)} frames"
            yield f"DIFFERENT: shown by a run of {count}"
            yield from (f"  {line}" for line in _table(a, b, result))
        case DifferenceUndecided(because=because, hint=hint):
            yield "undecided"
            yield from (f"  {line}" for line in because)
            yield f"  hint: {hint}"
        case _:
            assert_never(result)
    yield from _matching(result.matching)


def _matching(matching: Matching) -> Iterator[str]:
    for name_a, name_b in matching.same:
        if name_a != name_b:
            yield f"`{name_a}` of A is `{name_b}` of B"
    if matching.changed:
        yield f"changed: {_names(matching.changed)}"
    for declaration in matching.declarations:
        yield f"changed: {declaration}"
    if matching.only_a:
        yield f"only in A: {_names(matching.only_a)}"
    if matching.only_b:
        yield f"only in B: {_names(matching.only_b)}"
    for note in matching.notes:
        yield f"note: {note}"


def _names(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names)


# --- the run in which they differ ------------------------------------------------------------------


def _table(a: Program, b: Program, result: Different) -> Iterator[str]:
    """Yield a line per frame: the time, the inputs, and the winner and its command in A and in B."""
    sensors = {s.name: s for p in (b, a) for s in p.robot.sensors}
    shown_sensors = [n for n in sensors if any(n in x.readings for x in result.snapshots)]
    answers = list(dict.fromkeys(m for x in result.snapshots for m in x.answers))
    heads = [f"{name} of {side}" for pair in result.actuators for name, side in zip(pair, "AB", strict=True)]
    rows = [["time", *shown_sensors, *(f"{m} answers" for m in answers), *heads]]
    for snapshot, outcome_a, outcome_b in zip(result.snapshots, result.a, result.b, strict=True):
        rows.append(
            [
                f"{seconds(snapshot.t_ns)}{', restarted' if snapshot.restarted else ''}",
                *(reading_cell(sensors[n], snapshot) for n in shown_sensors),
                *(str(snapshot.answers.get(m, "nothing") or "no answer") for m in answers),
                *_sent(a, b, result, outcome_a, outcome_b),
            ]
        )
    yield from aligned(rows)
    yield from missing_lines(len(shown_sensors), result.needed_missing, result.could_change, len(sensors))


def _sent(a: Program, b: Program, result: Different, outcome_a: Outcome, outcome_b: Outcome) -> Iterator[str]:
    for name_a, name_b in result.actuators:
        for program, name, outcome in ((a, name_a, outcome_a), (b, name_b, outcome_b)):
            actuator = next(x for x in program.robot.actuators if x.name == name)
            yield decision_text(actuator, next(d for d in outcome.decisions if d.actuator == name))


# --- for other tools -------------------------------------------------------------------------------


def row(a: Program, b: Program, result: Result) -> dict[str, object]:
    """Return the result as a row for JSON."""
    matching = result.matching
    fields: dict[str, object] = {"verdict": verdict(result)}
    match result:
        case Same():
            fields |= {
                "by": "content" if result.by_content else "induction",
                "k": result.k,
                "over_reals": [reason_text(reason) for reason in result.over_reals],
            }
        case Different():
            fields |= {
                "actuators": [{"a": x, "b": y} for x, y in result.actuators],
                "frames": list(_frames(a, b, result)),
                "needed_missing": list(result.needed_missing),
                "could_change": list(result.could_change),
            }
        case DifferenceUndecided(because=because, hint=hint):
            fields |= {"because": list(because), "hint": hint}
        case _:
            assert_never(result)
    fields["modules"] = {
        "same": [{"a": x, "b": y} for x, y in matching.same],
        "changed": list(matching.changed),
        "only_a": list(matching.only_a),
        "only_b": list(matching.only_b),
    }
    fields["declarations"] = list(matching.declarations)
    return fields | {"notes": list(matching.notes)}


def verdict(result: Result) -> str:
    """Return one word for the result."""
    match result:
        case Same():
            return "same"
        case Different():
            return "different"
        case DifferenceUndecided():
            return "undecided"
        case _:
            assert_never(result)


def _frames(a: Program, b: Program, result: Different) -> Iterator[dict[str, object]]:
    sensors = {s.name: s for p in (b, a) for s in p.robot.sensors}.values()
    for snapshot, outcome_a, outcome_b in zip(result.snapshots, result.a, result.b, strict=True):
        yield {
            "frame": frame_row(sensors, snapshot),
            "answers": {m: None if x is None else list(x) for m, x in snapshot.answers.items()},
            "a": outcome_row(a, outcome_a),
            "b": outcome_row(b, outcome_b),
        }
