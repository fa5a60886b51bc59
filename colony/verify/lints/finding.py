"""The result of a lint."""

from __future__ import annotations

from dataclasses import dataclass

from colony.text.diagnostics import Diagnostic, note
from colony.text.source import Span
from colony.verify.contracts.results import Trace
from colony.verify.lints.proof import MAX_FRAMES


@dataclass(frozen=True, slots=True)
class Run:
    """A run of the reference interpreter that shows a finding about `subject`, by the commands of `actuator`.

    Without an actuator it shows those of all.
    """

    subject: str
    actuator: str | None
    trace: Trace


@dataclass(frozen=True, slots=True)
class Finding:
    """A diagnostic of a lint, with the run that shows it if the message alone cannot."""

    diagnostic: Diagnostic
    run: Run | None = None


def undecided(span: Span, what: str, hint: str) -> Diagnostic:
    """Return the note that neither a run nor a proof decides whether `what` happens."""
    because = f"no run of up to {MAX_FRAMES} frames shows it, and no proof rules it out"
    return note("V035", span, f"whether {what} is unknown: {because}", hint)
