"""The queue of proofs: one document at a time, after a pause, with an end."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from colony.editing.index import EditorFinding
from colony.editing.server.documents import EditedFile
from colony.editing.server.jobs import ProofVerdict, ProveAnswer, ProveJob
from colony.editing.server.protocol import Settings

PROVE_LIMIT_FACTOR = 4.0
"""Seconds after which the prover is stopped, as a multiple of the work that it may do."""

_PROVABLE = ("contract", "reach", "test", "module")


class ProofHost(Protocol):
    """What the queue needs of the session."""

    settings: Settings

    def notify(self, method: str, params: object) -> None:
        """Send a notification."""

    def refresh(self, *kinds: str) -> None:
        """Have the editor ask again for what it draws."""

    def publish(self, uri: str) -> None:
        """Send what is known of a document."""


class ProofQueue:
    """Decides what is proved, and keeps the verdicts. Stateful.

    Attributes:
        jobs: Jobs for the prover; the caller empties it.
        stops: True if the prover has to be stopped, whose answers do not matter any more.
    """

    def __init__(self, host: ProofHost, files: Mapping[str, EditedFile], number: Callable[[], int]) -> None:
        self.jobs: list[ProveJob] = []
        self.stops = False
        self._host, self._files, self._number = host, files, number
        self._proving: tuple[ProveJob, EditedFile, float] | None = None
        self._tests: list[tuple[EditedFile, str]] = []

    def give_up(self) -> None:
        """Stop the proof that is under way: its text has changed."""
        if self._proving is not None:
            self._proving[1].is_proved = False
            self._proving, self.stops = None, True

    def add_test(self, file: EditedFile, name: str) -> None:
        """Run a test as soon as nothing else is under way."""
        self._tests.append((file, name))

    def wake(self, now: float) -> None:
        """End a proof that takes too long, and begin the next one that is due."""
        if self._proving is not None and now >= self._proving[2]:
            self.stops = True
            self._end("not decided in time")
        if self._proving is None:
            self._begin(now)

    def deadline(self) -> float | None:
        """Return when `wake` has something to do next; None if nothing is planned."""
        if self._proving is not None:
            return self._proving[2]
        if self._tests:
            return 0.0
        if not self._host.settings.prove:
            return None
        return min((d for f in self._files.values() if (d := f.proof_due) is not None), default=None)

    def _begin(self, now: float) -> None:
        settings, test = self._host.settings, ""
        if self._tests:
            file, test = self._tests.pop(0)
        else:
            due = [f for f in self._files.values() if f.proof_due is not None and f.proof_due <= now]
            if not due or not settings.prove:
                return
            file = max(due, key=lambda f: f.touched_at)
            file.is_proved = True
            if not any(declared.kind in _PROVABLE for _, declared in file.own_declarations()):
                return
        job = ProveJob(self._number(), file.program(settings.robot), settings.seconds, test)
        self._proving = job, file, now + max(1.0, PROVE_LIMIT_FACTOR * settings.seconds)
        self.jobs.append(job)
        if not test:
            file.proof_state, file.proof_number = "proving", job.number
        self._host.refresh("codeLens")

    def answered(self, answer: ProofVerdict | ProveAnswer) -> None:
        """Handle an answer of the prover; one to a proof that was given up does not matter."""
        if self._proving is None or self._proving[0].number != answer.number:
            return
        if isinstance(answer, ProveAnswer):
            self._end("the prover failed" if answer.failed else answer.refusal, answer.findings)
            return
        file = self._proving[1]
        file.verdicts[answer.kind, answer.name] = answer
        self._show(file)

    def lost(self) -> None:
        """Go on without the prover, which died."""
        if self._proving is not None:
            self._end("the prover died")

    def _end(self, state: str, findings: list[EditorFinding] | None = None) -> None:
        assert self._proving is not None, "a proof is under way"
        (job, file, _), self._proving = self._proving, None
        if job.test:  # which leaves the verdicts of all else as they were
            self._report_test(job, file, state)
            return
        file.proof_state = state
        if findings is not None and not state:
            own = {(k, d.name) for _, d in file.own_declarations() for k in ("test", "contract")}
            file.verdicts = {key: verdict for key, verdict in file.verdicts.items() if key in own}
            file.proof_findings, file.text_proved = findings, job.program.texts[file.path]
            self._host.publish(file.uri)
        self._show(file)

    def _report_test(self, job: ProveJob, file: EditedFile, state: str) -> None:
        """Send the verdict of the test of a job, or why it has none."""
        self._show(file)
        verdict, type_, result = file.verdicts.get(("test", job.test)), 1, state or "there is no such test"
        if verdict is not None and verdict.number == job.number:
            type_, result = 1 if verdict.is_bad else 3, verdict.details
        self._host.notify("window/showMessage", {"type": type_, "message": f"{job.test}: {result}"})

    def _show(self, file: EditedFile) -> None:
        """Send the verdicts to the editor: as lenses, and as data for editors that show more."""
        self._host.refresh("codeLens")
        rows = [
            {"kind": v.kind, "name": v.name, "verdict": v.word, "details": v.details}
            for v in file.verdicts.values()
        ]
        self._host.notify("colony/verdicts", {"uri": file.uri, "state": file.proof_state, "verdicts": rows})
