"""Documents as a session keeps them: when each changed, and what was proved of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from colony.editing.features import margin
from colony.editing.index import EditorFinding
from colony.editing.open_file import OpenFile
from colony.editing.server.jobs import OpenProgram, ProofVerdict

ANALYZE_PAUSE_S = 0.1
"""Seconds after a change until the document is analyzed."""

LONGEST_WAIT_S = 1.0
"""Seconds after which a document is analyzed though it keeps changing."""

PROVE_PAUSE_S = 0.4
"""Seconds after the last change until contracts are proved."""

STALE = "before the last change"
"""The state of verdicts of an earlier text."""


@dataclass(slots=True)
class EditedFile(OpenFile):
    """A document with what is to be done about it. Mutable.

    Attributes:
        changed_at: The last change that is not analyzed; None if there is none.
        waits_since: The first change that is not analyzed.
        touched_at: The last change.
        published: The URIs of the files of its program.
        is_proved: True if its proofs are done or under way.
        verdicts: The last verdicts, by kind and name.
        proof_state: What is the case with the verdicts; "" if they are of the text as it is.
        proof_number: Number of the last job that proves the text as it is; 0 if there is none.
        proof_findings: What the prover found.
        text_proved: The text of which it found that.
    """

    changed_at: float | None = None
    waits_since: float | None = None
    touched_at: float = 0.0
    published: set[str] = field(default_factory=set)
    is_proved: bool = False
    verdicts: dict[tuple[str, str], ProofVerdict] = field(default_factory=dict)
    proof_state: str = ""
    proof_number: int = 0
    proof_findings: list[EditorFinding] = field(default_factory=list)
    text_proved: str = ""

    def touch(self, now: float) -> None:
        """Begin the pause after a change."""
        self.changed_at = self.touched_at = now
        self.waits_since = now if self.waits_since is None else self.waits_since
        self.is_proved, self.proof_number = False, 0
        if self.verdicts:
            self.proof_state = STALE

    @property
    def analysis_due(self) -> float | None:
        """When it is to be analyzed; None if it is."""
        if self.changed_at is None or self.waits_since is None:
            return None
        return min(self.changed_at + ANALYZE_PAUSE_S, self.waits_since + LONGEST_WAIT_S)

    @property
    def proof_due(self) -> float | None:
        """When it is to be proved; None if it is, or if it has errors."""
        is_current = self.changed_at is None and self.drift.start < 0 and self.known.is_valid
        return self.touched_at + PROVE_PAUSE_S if is_current and not self.is_proved else None

    def program(self, robot: str) -> OpenProgram:
        """Return its program with all open texts."""
        return OpenProgram(self.path, {path: other.text for path, other in self.others.items()}, robot)

    @property
    def proved_now(self) -> list[EditorFinding]:
        """What the prover found of the text as it is."""
        return self.proof_findings if self.drift.start < 0 and self.text_proved == self.text else []

    def lenses(self, *, proves: bool) -> list[Any]:
        """Return its lenses; `proves` is the setting."""
        waiting = "" if self.is_proved or not proves or self.proof_due is None else "waiting"
        return list(margin.lenses(self, self.verdicts, self.proof_state or waiting))
