"""Conditions as sentences, with the values that decided them."""

from __future__ import annotations

from typing import NamedTuple, assert_never

from colony.text.wording import duration_text, listed, rounded_ns, time_text
from colony.verify.explain.causes import (
    Answered,
    Cause,
    Comparison,
    Constant,
    Heard,
    Past,
    Present,
    Reading,
    Remembered,
    Sendable,
    TimeConstant,
    Undisturbed,
    Unknown,
    Unwired,
)


class FrameTime(NamedTuple):
    """The time of an explained frame, and that from which times in texts count."""

    t_ns: int
    begin_ns: int = 0

    def text(self, at_ns: int) -> str:
        """Return a time."""
        return time_text(at_ns - self.begin_ns)

    def ago(self, at_ns: int) -> str:
        """Return `10.2 s, 1.5 s before`, the time of what led to the frame."""
        before = f", {duration_text(rounded_ns(self.t_ns - at_ns))} before"
        return f"{self.text(at_ns)}{'' if at_ns == self.t_ns else before}"


def cause_text(cause: Cause, holds: bool, now: FrameTime) -> str:
    """Return a condition of a frame as a sentence, with the values that decided it."""
    match cause:
        case Comparison(condition=condition, left=left, right=right, gap=gap):
            by = "" if gap is None or gap.startswith("0 ") or gap == "0" else f" by {gap}"
            is_said = left == right and left[:1].isalpha() and left in condition.split()
            sides = "" if is_said else f": {left} against {right}"
            return f"`{condition}` {_verdict(holds)}{by}{sides}{detail_text(cause.detail)}"
        case Reading(condition=condition, detail=detail):
            return f"`{condition}` is {truth_text(holds)}{detail_text(detail)}"
        case Constant(condition=condition):
            return f"`{condition}` is always {truth_text(holds)}"
        case Remembered(condition=condition, value=value, since_ns=since_ns):
            since = "" if since_ns is None else f", set at {now.ago(since_ns)}"
            return f"`{condition}` remembers {value}{since}"
        case Past():
            return _past_text(cause, holds, now)
        case Present():
            return _present_text(cause, now)
        case Unknown(condition=condition, missing=missing):
            what = f"{listed(missing)} {'are' if len(missing) > 1 else 'is'}" if missing else "something is"
            return f"`{condition}` is unknown: {what} missing"
        case _:
            return _runtime_text(cause, holds, now)


def _runtime_text(
    cause: TimeConstant | Answered | Heard | Undisturbed | Sendable | Unwired, holds: bool, now: FrameTime
) -> str:
    match cause:
        case TimeConstant(dominant=dominant, window_ns=window_ns, at_ns=at_ns):
            window = duration_text(window_ns)
            if at_ns is None:
                return f"{dominant} has not been active, so its time constant of {window} does not count"
            counts = "still counts" if holds else "is over"
            return f"{dominant} was last active at {now.ago(at_ns)}; its time constant of {window} {counts}"
        case Answered(module=module, error=error, blind=blind):
            if error:
                return f"the module in Python {module} failed in this frame"
            if blind:
                return f"the module in Python {module} has no answer{', and is failsafe' if holds else ''}"
            return (
                f"the module in Python {module} answered {'with a command' if holds else 'with no command'}"
            )
        case Heard(module=module, fate=fate):
            if fate is None:
                return f"the client of {module} was in time"
            return f"the client of {module} was {fate}{_FATES.get(fate, '')}"
        case Undisturbed(actuator=actuator, outside=outside, hold=hold):
            return _disturbance_text(actuator, outside, hold)
        case Sendable(actuator=actuator, module=module, fault=fault):
            if fault is None:
                return f"the command of {module} could be sent to {actuator}"
            return f"the command of {module} could not be sent to {actuator}: {FAULTS.get(fault, fault)}"
        case Unwired(actuator=actuator, module=module_or_none):
            what = "no module is wired" if module_or_none is None else f"no wire leads from {module_or_none}"
            return f"{what} to {actuator}"
        case _:
            assert_never(cause)


FAULTS = {
    "missing": "it is failsafe and has no answer, so the idle command was sent",
    "not finite": "a field was not a finite number, so the idle command was sent",
    "bound missing": "the bound of a limit was missing, and there is no idle command",
    "limits contradict": "a lower limit was above an upper one, so the idle command was sent",
}
"""Sentences about faults of commands."""

_FATES = {
    "late": ": its request had not come when the frame was decided",
    "lost": ": its process did not answer",
    "refused": ": its request was malformed",
}


def _disturbance_text(actuator: str, outside: str | None, hold: str | None) -> str:
    match hold:
        case "stopped":
            reason = "the emergency stop was on"
        case "locked":
            reason = "a connection held the lock"
        case _:
            reason = ""
    if outside is not None:
        also = f", and {reason}" if reason else ""
        return f"the connection {outside} commanded {actuator} from outside the network{also}"
    return reason or f"nobody outside the network commanded {actuator}"


def _past_text(past: Past, holds: bool, now: FrameTime) -> str:
    duration = duration_text(past.duration_ns)
    elapsed = "" if past.elapsed_ns is None else duration_text(past.elapsed_ns)
    match past.function, past.at_ns:
        case "recently", None:
            return f"`{past.condition}` has not been true before"
        case "recently", int(at_ns):
            relation = "within" if holds else "longer ago than"
            return f"`{past.condition}` was last true at {now.ago(at_ns)}: {relation} {duration}"
        case "sustained", None:
            return f"`{past.condition}` must have been true for {duration}"
        case "sustained", int(at_ns):
            relation = "long enough" if holds else f"{elapsed} of {duration}"
            return f"`{past.condition}` is true since {now.text(at_ns)}: {relation}"
        case _:
            raise AssertionError(past.function)


def _present_text(present: Present, now: FrameTime) -> str:
    if present.why is None:
        return f"{present.sensor} has a reading"
    since = (
        "it has had none so far" if present.since_ns is None else f"missing since {now.ago(present.since_ns)}"
    )
    match present.why:
        case "server down":
            why = f"the server {present.server} was down"
        case "too old":
            age = "" if present.within_ns is None else f" than {duration_text(present.within_ns)}"
            why = f"its reading was older{age}"
        case "from the future":
            why = "its reading was taken after the frame"
        case "faulty":
            why = "its reading was not of its type"
        case "no reading":
            within = "" if present.within_ns is None else f" within {duration_text(present.within_ns)}"
            why = f"{present.server} gave no value{within}"
        case _:
            assert_never(present.why)
    return f"{present.sensor} is missing: {why}; {since}"


def _verdict(holds: bool) -> str:
    return "holds" if holds else "fails"


def truth_text(holds: bool) -> str:
    """Return the word for a value."""
    return "true" if holds else "false"


def detail_text(detail: tuple[str, ...]) -> str:
    """Return the values of inputs, in parentheses; nothing if there are none."""
    return f" ({'; '.join(detail)})" if detail else ""
