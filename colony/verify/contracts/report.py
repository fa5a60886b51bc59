"""Results as lines of text, as diagnostics, and as objects for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from math import isinf
from shlex import quote
from typing import assert_never

from colony.ir.frame import Outcome
from colony.ir.program import Program, Sensor, in_declared_units
from colony.ir.types import ScalarValue, Value
from colony.text.diagnostics import Diagnostic, error, note, warning
from colony.text.wording import counted, quoted
from colony.verify.contracts.results import (
    VERDICTS,
    OverReals,
    Proved,
    ProvedInTime,
    Refuted,
    Result,
    Trace,
    Unknown,
    length_text,
    never_reached,
    rank,
)
from colony.verify.contracts.table import decision_text, reading_text, seconds, table
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.system import Reason

# --- frames -------------------------------------------------------------------------------------------
#
# Counterexamples as frames that `colony trace --input` accepts: plain values in declared units.


def frame_row(sensors: Iterable[Sensor], snapshot: Snapshot) -> dict[str, object]:
    """Return a frame: `{"t": 0.05, "bumper": true, "sonar": [3.0, ...]}`; missing values are null.

    Args:
        sensors: Sensors of the program, or programs, that the snapshot is for.
        snapshot: Time, and readings in base units.
    """
    by_name = {sensor.name: sensor for sensor in sensors}
    readings = {name: _plain(by_name[name], value) for name, value in snapshot.readings.items()}
    restarted = {"restarted": True} if snapshot.restarted else {}
    return {"t": snapshot.t_ns / 1e9, **restarted, **readings}


def outcome_row(program: Program, outcome: Outcome) -> dict[str, object]:
    """Return each actuator's winner and command: `{"drive": {"by": "avoid", "velocity": 0.15}}`."""
    fields = {a.name: [f.name for f in a.fields] for a in program.robot.actuators}
    return {
        d.actuator: {"by": d.by, **dict(zip(fields[d.actuator], d.values or (), strict=False))}
        for d in outcome.decisions
    }


def _plain(sensor: Sensor, value: Value | None) -> object:
    if isinstance(value, tuple):
        return [_declared(sensor, element) for element in value]
    return None if value is None else _declared(sensor, value)


def _declared(sensor: Sensor, value: ScalarValue) -> ScalarValue:
    """Return the value in the declared unit that converts back to exactly `value`."""
    if isinstance(value, bool):
        return value
    quotient = value / sensor.factor
    candidates = (quotient, math.nextafter(quotient, math.inf), math.nextafter(quotient, -math.inf))
    return next((x for x in candidates if x * sensor.factor == value), quotient)


# --- report -------------------------------------------------------------------------------------------

_MAX_LOCATIONS = 3

_OVER_REALS_HINT = (
    "leave room for rounding: compare with a bound that is a little wider, or keep numbers whole and "
    "bounded; if there is room, give the proof in floats more time: --timeout 60"
)

_IN_TIME = "proved while every client is in time"
_OPEN = "where clients are late or lost, it is neither proved nor refuted"


def verdict(result: Result) -> str:
    """Return the verdict of a contract, or of a reach, in words."""
    word = _contract_verdict(result)
    return VERDICTS.get(word, word) if result.contract.reach else word


def _contract_verdict(result: Result) -> str:
    match result:
        case Proved(contract=contract):
            return "proved in time" if contract.in_time else "proved"
        case ProvedInTime():
            return "proved in time"
        case OverReals():
            return "over reals"
        case Refuted():
            return "REFUTED"
        case Unknown():
            return "unknown"
        case _:
            assert_never(result)


def verdict_key(result: Result) -> str:
    """Return the verdict as JSON has it."""
    return verdict(result).lower().replace(" ", "_")


def counted_as(result: Result) -> str:
    """Return the verdict as the summary counts it: no more was asked of a contract `in time`."""
    is_proved = isinstance(result, Proved) and not result.contract.reach
    return "proved" if is_proved else verdict_key(result)


def lines(program: Program, result: Result) -> tuple[str, ...]:
    """Return the verdict on one line, and the refuting trace or the reasons indented below it."""
    word = verdict(result)
    head = f"{word:8}{' ' if ' ' in word else ''} {result.contract.name}"
    if result.contract.assuming and rank(result):
        head += f"  (assuming {', '.join(result.contract.assuming)})"
    match result:
        case OverReals(proof=proof, in_time=in_time):
            _, *below = lines(program, proof)
            return (f"{head}  (floats may round at {locations(in_time.over_reals)})", *below)
        case Proved() if result.contract.in_time:
            return (head,)
        case Proved(operators=True):
            return (f"{head}  (operators too)",)
        case Proved(operator_runs=None):
            return (f"{head}  (without operators: --why {result.contract.name})",)
        case Proved(operator_runs=(trace,)):
            found = "a command from outside the network breaks it, within the limits:"
            shown_rows = (found, *table(program, result.contract, trace))
            return (f"{head}  (without operators)", *_indented(shown_rows))
        case Proved():
            found = "no run was found in which a command from outside the network breaks it"
            return (f"{head}  (without operators)", *_indented((found,)))
        case ProvedInTime(trace=trace, because=because, python_trace=python_trace):
            shown = trace or python_trace
            rows = () if shown is None else table(program, result.contract, shown)
            why = (_broken_text(trace),) if trace is not None else (f"it is {_IN_TIME}; {_OPEN}:", *because)
            return (head, *_indented((*why, *rows)))
        case Refuted(trace=trace):
            head += f"  {length_text(trace)}" if result.contract.reach else ""
            return (head, *_indented(table(program, result.contract, trace)))
        case Unknown(trace=trace):
            rows = () if trace is None else table(program, result.contract, trace)
            return (head, *_indented(result.because), *_indented(rows))
        case _:
            assert_never(result)


def _broken_text(trace: Trace) -> str:
    return f"it is {_IN_TIME}; the run below breaks it, in which {_disturbance(trace)}:"


def _broken(trace: Trace) -> str:
    return "is neither true nor false" if trace.unknown else "is false"


def _disturbance(trace: Trace) -> str:
    """Return what disturbs a run: "the client of `drive` is late", "a client is lost", or both."""
    idle = tuple(dict.fromkeys(actuator for s in trace.snapshots for actuator in s.given))
    late = f"the client of {quoted(idle)} is late" if idle else ""
    lost = "a client is lost" if any(s.lost for s in trace.snapshots) else ""
    return " and ".join(filter(None, (late, lost)))


def _indented(rows: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"  {row}" for row in rows)


def locations(reasons: Iterable[Reason]) -> str:
    """Return the files and lines of reasons: `rome.colony:70 and 2 more lines`."""
    in_order = sorted(reasons, key=lambda r: (r.span.source.name, r.span.start))
    locations = list(dict.fromkeys(map(_location, in_order)))
    omitted = len(locations) - _MAX_LOCATIONS
    return ", ".join(locations[:_MAX_LOCATIONS]) + (f" and {omitted} more lines" if omitted > 0 else "")


def _location(reason: Reason) -> str:
    """Return the file and line of a reason, or its text if it is not in a file."""
    source = reason.span.source
    return f"{source.name}:{source.position(reason.span.start)[0]}" if source.text else reason.text


def reason_text(reason: Reason) -> str:
    """Return a reason with its file and line."""
    return f"{_location(reason)}: {reason.text}" if reason.span.source.text else reason.text


def finding(result: Result, file: str | None, *, is_shown: bool = False) -> Diagnostic | None:
    """Return an error for a refuted contract, a warning for an unknown one, None for a proved one.

    It is the other way round for a reach, of which the run is what was asked for.
    For one that is proved only while every client is in time, or only over real numbers, it is a note.

    The hint suggests adding the run to `file` as a test; `file` is None if the run is added anyway. With
    `is_shown`, the message leaves out what the lines of the result say.
    """
    contract = result.contract
    kind = "reach" if contract.reach else "contract"
    match result:
        case Proved():
            return never_reached(result) if contract.reach else None
        case ProvedInTime():
            return note(
                "V012", contract.span, _in_time_message(result, is_shown=is_shown), _in_time_hint(result)
            )
        case OverReals(proof=proof, in_time=in_time):
            only = " and only while every client is in time" if isinstance(proof, ProvedInTime) else ""
            where = locations(in_time.over_reals)
            proved = "proved never to be reached" if contract.reach else "proved"
            claim = f"{kind} `{contract.name}` is {proved} only over real numbers{only}"
            return note("V014", contract.span, f"{claim}: floats may round at {where}", _OVER_REALS_HINT)
        case Refuted() if contract.reach:
            return None
        case Refuted(trace=trace):
            time = time_of_breach(trace)
            found = f"; found: {'; '.join(trace.found)}" if trace.found and not is_shown else ""
            length = counted(len(trace.snapshots), "frame")
            how = _broken(trace)
            message = f"contract `{contract.name}` {how} at {time} of a run of {length}{found}"
            return error("V010", contract.span, message, _hint(trace, file))
        case Unknown(because=because, hint=hint):
            found = (
                "is neither reached nor proved never to be"
                if contract.reach
                else "is neither proved nor refuted"
            )
            message = f"{kind} `{contract.name}` {found}"
            message += "" if is_shown else f": {_on_one_line(because)}"
            return warning("V011", contract.span, message, hint)
        case _:
            assert_never(result)


def _in_time_message(result: ProvedInTime, *, is_shown: bool) -> str:
    start = f"contract `{result.contract.name}` is {_IN_TIME.replace('while', 'only while')};"
    trace = result.trace
    if trace is None:
        return f"{start} {_OPEN}" + ("" if is_shown else f": {_on_one_line(result.because)}")
    how = _broken(trace)
    length = counted(len(trace.snapshots), "frame")
    found = f"; found: {'; '.join(trace.found)}" if trace.found and not is_shown else ""
    time = time_of_breach(trace)
    return f"{start} it {how} at {time} of a run of {length} in which {_disturbance(trace)}{found}"


def _in_time_hint(result: ProvedInTime) -> str | None:
    """Return advice on the frames of the run in which clients are late or lost."""
    trace = result.trace
    if trace is None:
        return result.hint
    *before, last = trace.snapshots
    late_now, late_before = next(iter(last.given), None), next((a for s in before for a in s.given), None)
    advice: list[str] = []
    if late_now is not None:
        advice.append(
            "an actuator whose client is late is idle, whatever others do: say what must hold then "
            f"(`{late_now} is idle or ...`)"
        )
    elif late_before is not None:
        advice.append(
            "an actuator whose client was late was idle in that frame: say what must hold then and after it "
            f"(`{late_before} is idle or previous({late_before} is idle, true) or ...`)"
        )
    if any(s.lost for s in trace.snapshots):
        advice.append(
            "with `on_loss degrade`, a lesser client acts in place of one that is lost: say what must hold "
            "then, or use `on_loss stop`"
        )
    name = result.contract.name.rpartition(".")[2]
    advice.append(f"or write `contract {name} in time: ...` if that is what you mean")
    return "; ".join(advice)


def _on_one_line(because: tuple[str, ...]) -> str:
    """Return reasons on one line; those that a line with a colon announces follow it."""
    return "; ".join(line.strip() for line in because).replace(":; ", ": ")


def _hint(trace: Trace, file: str | None) -> str | None:
    """Return advice on a counterexample; a test cannot express an infinite reading."""
    infinite = (
        name
        for snapshot in trace.snapshots
        for name, value in snapshot.readings.items()
        if any(x is not None and isinf(x) for x in (value if isinstance(value, tuple) else (value,)))
    )
    name = next(infinite, None)
    if name is not None:
        return f"`{name}` is infinite there: give it a `range`, which bounds its readings"
    if trace.unknown:
        return (
            "a contract must be true, and is not if what decides it is missing: write "
            "`fresh(X) implies ...` or `value_or(X, ...)`, and a second contract for X missing; of a field "
            "that may never have been sent, `ACTUATOR is commanded implies ...`"
        )
    if file is None:
        return None
    return f"`colony verify --write-test {quote(file)}` adds the run to it as a test"


def time_of_breach(trace: Trace) -> str:
    """Return the time of the last frame, which breaks the contract."""
    return str(seconds(trace.snapshots[-1].t_ns))


def row(program: Program, result: Result) -> dict[str, object]:
    """Return a result as an object for JSON; docs/verification.md describes its keys."""
    line, column = result.contract.span.source.position(result.contract.span.start)
    result_row: dict[str, object] = {
        "reach" if result.contract.reach else "contract": result.contract.name,
        "file": result.contract.span.source.name,
        "line": line,
        "column": column,
        "verdict": verdict_key(result),
        "assuming": list(result.contract.assuming),
    }
    if not result.contract.reach:
        result_row["in_time"] = result.contract.in_time
    match result:
        case Proved(operators=operators, operator_runs=runs):
            result_row |= {**_proof_row(result), "operators": operators}
            if runs is not None:
                result_row["operator_runs"] = [trace_rows(program, trace) for trace in runs]
        case OverReals(proof=proof):
            result_row |= {key: value for key, value in row(program, proof).items() if key not in result_row}
        case ProvedInTime(in_time=in_time, because=because):
            shown = result.trace or result.python_trace
            result_row |= {**_proof_row(in_time), "operators": False}
            result_row |= {"because": [b.strip() for b in because], "hint": _in_time_hint(result)}
            result_row["trace"] = None if shown is None else trace_rows(program, shown)
        case Refuted(trace=trace):
            result_row |= {"trace": trace_rows(program, trace), "cause": trace.cause}
        case Unknown(because=because, hint=hint, trace=unknown_trace):
            result_row |= {"because": [b.strip() for b in because], "hint": hint}
            result_row["trace"] = None if unknown_trace is None else trace_rows(program, unknown_trace)
        case _:
            assert_never(result)
    return result_row


def _proof_row(proved: Proved) -> dict[str, object]:
    over_reals = [reason_text(r) for r in proved.over_reals]
    return {"k": proved.k, "invariants": list(proved.invariants), "over_reals": over_reals}


def trace_rows(program: Program, trace: Trace) -> list[dict[str, object]]:
    """Return an object per frame: the inputs, as `colony trace --input` takes them, and the commands sent.

    Frames in which clients are late have those actuators as `late`, those that an operator commands as
    `commanded`, and lost modules as `lost`.
    """
    reaches = {reach.name for reach in program.reaches}
    return [
        {
            "frame": frame_row(program.robot.sensors, snapshot),
            "answers": {m: None if a is None else list(a) for m, a in snapshot.answers.items()},
            **_given_row(program, snapshot),
            **({"lost": sorted(snapshot.lost)} if snapshot.lost else {}),
            "sent": outcome_row(program, outcome),
            "broken": [name for name in outcome.breaches if name not in reaches],
        }
        for snapshot, outcome in zip(trace.snapshots, trace.outcomes, strict=True)
    ]


def _given_row(program: Program, snapshot: Snapshot) -> dict[str, object]:
    """Return the actuators that are late, and those that an operator commands, in declared units."""
    late = sorted(name for name, given in snapshot.given.items() if given.values is None)
    commanded = {
        a.name: dict(zip((f.name for f in a.fields), values, strict=True))
        for a in program.robot.actuators
        if a.name in snapshot.given
        and (values := in_declared_units(snapshot.given[a.name].values, a.fields)) is not None
    }
    return ({"late": late} if late else {}) | ({"commanded": commanded} if commanded else {})


def readable_frames(
    program: Program, snapshots: Iterable[Snapshot], outcomes: Iterable[Outcome]
) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield each frame's events, and the readings of each sensor, in readable form."""
    sensors = {s.name: s for s in program.robot.sensors}
    for snapshot, outcome in zip(snapshots, outcomes, strict=True):
        decided = (
            f"{a.name} {decision_text(a, d, snapshot.given.get(a.name))}"
            for a, d in zip(program.robot.actuators, outcome.decisions, strict=True)
        )
        restarted = ("restarted",) if snapshot.restarted else ()
        events = "; ".join((f"t = {snapshot.t_ns / 1e9:.9g} s", *restarted, *decided))
        yield events, {n: reading_text(sensors[n], value) for n, value in snapshot.readings.items()}
