"""The result of a lint."""

from __future__ import annotations

from dataclasses import dataclass

from colony.text.diagnostics import Diagnostic
from colony.verify.contracts.results import Trace


@dataclass(frozen=True, slots=True)
class Run:
    """A run of the reference interpreter that shows a finding about `subject`, a field of `actuator`."""

    subject: str
    actuator: str
    trace: Trace


@dataclass(frozen=True, slots=True)
class Finding:
    """A diagnostic of a lint, with the run that shows it if the message alone cannot."""

    diagnostic: Diagnostic
    run: Run | None = None
