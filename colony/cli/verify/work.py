"""The work of `colony verify` on a file: contracts, then modules that can never act, then drawn traces."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from colony.cli.outputs import cannot_write, write_whole
from colony.cli.progress import ReportProgress
from colony.cli.reporting import check_to_run, say
from colony.cli.verify.prover_options import DEFAULT_SECONDS
from colony.dsl.files import MAX_BYTES
from colony.files import read_file, reason
from colony.text.diagnostics import DiagnosticError

if TYPE_CHECKING:
    from colony.ir.program import Program
    from colony.text.diagnostics import Diagnostic
    from colony.verify.contracts.kept import ProofCache
    from colony.verify.contracts.margins import Margin
    from colony.verify.contracts.prove import ContractProver
    from colony.verify.contracts.results import ProofOptions, Refuted, Result
    from colony.verify.contracts.solver import Deadline
    from colony.verify.lints.proof import Finding
    from colony.verify.symbolic.system import Shape
    from colony.verify.testing.differential import DifferentialReport


# --- certificates --------------------------------------------------------------------------------------
#
# Certificates of proofs, written by `colony verify --certificate`.


def make_folder(folder: Path) -> None:
    """Make the folder of certificates or of a report before the work begins; exit with 2 if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        cannot_write(folder, reason(problem))


def write_certificate(folder: Path, options: ProofOptions, prover: ContractProver, result: Result) -> None:
    """Write the certificate of a contract that `prover` has proved, or remove that of an earlier version."""
    from colony.verify.contracts.certificate import certificate
    from colony.verify.contracts.results import OverReals, Proved, ProvedInTime

    path = folder / f"{result.contract.name}.smt2"
    if isinstance(result, Proved | ProvedInTime):
        text = certificate(prover, result, options)
        if text is not None:
            write_whole(path, text)
            return
        say(f"{path}: no certificate: z3 gave up; raise --timeout")
    elif isinstance(result, OverReals):
        say(f"{path}: no certificate: {result.contract.name} is proved only over real numbers")
    try:
        path.unlink(missing_ok=True)
    except OSError as problem:
        cannot_write(path, reason(problem))


# --- tests ---------------------------------------------------------------------------------------------
#
# Counterexamples appended to behavior files as tests.


def check_writable(file: str, option: str = "--write-test") -> None:
    """Refuse a file that cannot be replaced, as an option does, before the work begins; exit with 2."""
    path = Path(file)
    if not os.access(path, os.W_OK):
        cannot_write(path, f"Permission denied ({option} appends to it)")
    if path.is_file() and not os.access(path.resolve().parent, os.W_OK | os.X_OK):
        cannot_write(path, f"Permission denied in its folder ({option} replaces it)")


def append_tests(file: str, program: Program, refuted: Sequence[Refuted]) -> None:
    """Append a `test` block for each refuted contract or reach, and report it; exit with 2 if that fails.

    The file is replaced atomically. A test that it contains already is not written again.
    """
    text = _bytes(Path(file)).decode("utf-8-sig").replace("\r\n", "\n")
    titles = {existing.name for existing in program.tests}
    blocks: list[str] = []
    written: list[str] = []
    for result in refuted:
        test = _new_test(program, result, titles, text)
        if test is None:
            what = "what it reaches, or one of its values" if result.contract.reach else "one of its values"
            say(f"{file}: no test for {result.contract.name}: the language cannot express {what}")
        elif test.block in text:
            say(f'{file}: the test "{test.title}" already exists')
        else:
            titles.add(test.title)
            blocks.append(test.block)
            written.append(test.title)
    if blocks:
        append_blocks(Path(file), blocks)
    for name in written:
        say(f'{file}: wrote the test "{name}"')


class _Test(NamedTuple):
    title: str
    block: str


def _new_test(program: Program, result: Refuted, titles: set[str], text: str) -> _Test | None:
    """Return the test, titled with the first free title or the title of the same test in `text`."""
    from colony.verify.contracts.example_block import example_block, title

    number = 1
    while True:
        name = title(result.contract) + (f" ({number})" if number > 1 else "")
        block = example_block(program, result.contract, result.trace, name)
        if block is None:
            return None
        if name not in titles or block in text:
            return _Test(name, block)
        number += 1


def _bytes(path: Path) -> bytes:
    try:
        return read_file(path, MAX_BYTES)
    except OSError as problem:
        cannot_write(path, reason(problem))


def append_blocks(path: Path, blocks: Sequence[str]) -> None:
    """Append blocks to the file, with the same kind of line breaks; exit with 2 if that fails."""
    before = _bytes(path)
    added = "".join(f"\n{block}" for block in blocks)
    if before and not before.endswith(b"\n"):
        added = f"\n{added}"
    if b"\r\n" in before:
        added = added.replace("\n", "\r\n")
    write_whole(path, before + added.encode())


# --- work ----------------------------------------------------------------------------------------------


_LINT_FACTOR = 2
"""Limit for all questions about modules that can never act, in multiples of the limit per contract."""


_SECONDS_OF_A_MARGIN = 2
"""Limit for each attempt at a contract with other readings, in seconds of the prover."""

_SECONDS_OF_MARGINS = 600
"""Limit for all margins of a file without `--timeout`, in seconds of the prover."""


@dataclass(slots=True, frozen=False)
class Verified:
    """The results for a file so far. Mutable.

    `program` is without what it assumes, `checked` the whole.
    """

    file: str
    program: Program | None
    diagnostics: list[Diagnostic]
    results: list[Result] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    report: DifferentialReport | None = None
    margins: list[Margin] = field(default_factory=list)
    shows_runs: bool = False  # of margins, too
    undecided_questions: int = 0  # questions about modules that can never act
    writes_tests: bool = False
    checked: Program | None = None

    @property
    def suggested_file(self) -> str | None:
        """The file to which hints suggest adding tests; None if tests are added anyway."""
        return None if self.writes_tests else self.file

    @property
    def refuted(self) -> list[Refuted]:
        """The contracts that the prover refuted, and the reaches of which it found the run."""
        from colony.verify.contracts.results import Refuted

        return [r for r in self.results if isinstance(r, Refuted)]

    @property
    def is_undecided(self) -> bool:
        """True if a contract is unknown or over reals, or a question about modules was not decided."""
        from colony.verify.contracts.results import OverReals, Unknown

        return self.undecided_questions > 0 or any(isinstance(r, Unknown | OverReals) for r in self.results)

    @property
    def bug(self) -> str | None:
        """The executors' disagreement, a bug of colony; None if they agree."""
        if self.report is None:
            return None
        from colony.cli.verify.examples import bug

        return bug(self.report)

    @property
    def refuted_names(self) -> frozenset[str]:
        """The names of `refuted`."""
        return frozenset(r.contract.name for r in self.refuted)


def load(file: str, *, write_test: bool) -> Verified:
    """Check a file and record its errors; without a program nothing else is verified."""
    checked = check_to_run(file)
    if checked.program is None:
        return Verified(file, None, list(checked.diagnostics))
    from colony.ir.program import without_assumed

    required = without_assumed(checked.program)
    return Verified(file, required, [], writes_tests=write_test, checked=checked.program)


@dataclass(slots=True, frozen=False)
class _Proofs:
    """What is to be proved of a program, and what is known about it. Mutable."""

    program: Program
    names: list[str]
    options: ProofOptions
    cache: ProofCache
    deadline: Deadline
    shapes: dict[str, Shape] = field(default_factory=dict)


@dataclass(slots=True, frozen=True, kw_only=True)
class Work:
    """The options of `colony verify` that determine the work on each file."""

    names: tuple[str, ...]
    why: tuple[str, ...]
    depth: int
    timeout: float | None
    certificates: Path | None
    examples: int
    seed: int
    faults: bool
    margin: bool

    def run(self, verified: Verified, on_progress: ReportProgress) -> Iterator[Result]:
        """Do all of the work on a file, and yield the result of each contract when it is known."""
        if verified.program is None or verified.checked is None:
            return
        from colony.verify.contracts.kept import ProofCache, cache_folder
        from colony.verify.contracts.results import ProofOptions, with_reaches
        from colony.verify.contracts.solver import Deadline

        program, seconds = with_reaches(verified.checked), self.timeout or DEFAULT_SECONDS
        options = ProofOptions.within(seconds, depth=self.depth, in_all=self.timeout is not None)
        contracts = with_reaches(verified.program).contracts
        names = [c.name for c in contracts if not self.names or c.name in self.names]
        cache = ProofCache(cache_folder(os.environ), program, options, names)

        def on_stage(stage: str) -> None:
            on_progress(len(verified.results), len(names), stage)

        proofs = _Proofs(program, names, options, cache, Deadline(options.total, on_stage))
        yield from self._contracts(verified, proofs, on_progress)
        if self.margin:
            self._margins(verified, on_stage)
        self._assumptions(verified, proofs)
        self._lints(verified, verified.program, proofs, on_progress)
        if self.examples:
            self._examples(verified, verified.program, on_progress)

    def _contracts(
        self, verified: Verified, proofs: _Proofs, on_progress: ReportProgress
    ) -> Iterator[Result]:
        from colony.verify.contracts.disturbances import with_operator_runs
        from colony.verify.contracts.prove import results
        from colony.verify.contracts.report import finding
        from colony.verify.contracts.results import Proved, Refuted

        program, names = proofs.program, proofs.names
        on_progress(0, len(names), names[0] if names else "")
        folder = self.certificates
        certify = None if folder is None else partial(write_certificate, folder, proofs.options)
        cache = proofs.cache if certify is None else None  # it has results without their proofs
        parts_after = 0 if self.names else 1  # for what can never act
        for result in results(
            program, names, proofs.options, proofs.shapes, cache, certify, proofs.deadline, parts_after
        ):
            if isinstance(result, Proved) and not result.operators and result.contract.name in self.why:
                result = with_operator_runs(program, result)
            verified.results.append(result)
            diagnostic = finding(result, verified.suggested_file)
            verified.diagnostics += [diagnostic] if diagnostic else []
            if verified.writes_tests and isinstance(result, Refuted):
                append_tests(verified.file, program, [result])
            yield result
            count = len(verified.results)
            on_progress(count, len(names), names[count] if count < len(names) else "what can never act")

    def _margins(self, verified: Verified, on_stage: Callable[[str], None]) -> None:
        from colony.verify.contracts.margins import margins
        from colony.verify.contracts.results import RESOURCES_PER_SECOND, ProofOptions
        from colony.verify.contracts.solver import Deadline

        assert verified.checked is not None
        options = ProofOptions.within(_SECONDS_OF_A_MARGIN, depth=self.depth)
        seconds = self.timeout or _SECONDS_OF_MARGINS
        deadline = Deadline(round(seconds * RESOURCES_PER_SECOND), on_stage)
        verified.shows_runs = bool(self.names)
        for margin in margins(verified.checked, verified.results, options, deadline):
            verified.margins.append(margin)

    def _assumptions(self, verified: Verified, proofs: _Proofs) -> None:
        """Look for assumptions that no run meets, or that are always true."""
        from colony.ir.program import assumptions
        from colony.verify.contracts.assumptions import doubtful_assumptions

        if self.names or not assumptions(proofs.program):
            return
        known = proofs.cache.found("assumptions", list)
        if known is None:
            proofs.deadline.begin_stage("runs that meet the assumptions")
            known = doubtful_assumptions(proofs.program, proofs.options, proofs.deadline)
            proofs.cache.keep_found("assumptions", known)
        verified.diagnostics += known

    def _lints(
        self, verified: Verified, program: Program, proofs: _Proofs, on_progress: ReportProgress
    ) -> None:
        if self.names:
            return
        from colony.verify.lints import Effort, lint

        done = len(verified.results)

        def on_question(number: int) -> None:
            on_progress(done, done, f"what can never act: question {number}")

        known = proofs.cache.found("lints", tuple)
        if known is None:
            proofs.deadline.begin_part(1)
            limit = _LINT_FACTOR * proofs.options.resources
            effort = Effort(round(min(limit, max(0, proofs.deadline.left))), on_question)
            known = lint(program, effort, proofs.shapes), effort.questions_skipped
            proofs.cache.keep_found("lints", known)
        findings, verified.undecided_questions = known
        verified.findings += findings
        verified.diagnostics += [f.diagnostic for f in findings]

    def _examples(self, verified: Verified, program: Program, on_progress: ReportProgress) -> None:
        from colony.cli.verify.examples import findings, reports
        from colony.ir.program import assumptions
        from colony.verify.contracts.assumptions import under

        if verified.checked is not None:
            program = under(verified.checked, [a.name for a in assumptions(verified.checked)])
        if self.names:
            selected = tuple(c for c in program.contracts if c.name in self.names)
            program = replace(program, contracts=selected)
        try:
            with redirect_stdout(sys.stderr):  # for prints of Python modules
                for verified.report in reports(program, self.examples, self.seed, faults=self.faults):
                    on_progress(verified.report.drawn, self.examples, "drawn traces")
        except DiagnosticError as failure:
            verified.diagnostics += failure.diagnostics
        finally:
            if verified.report is not None:
                verified.diagnostics += findings(
                    program, verified.report, verified.suggested_file, verified.refuted_names
                )
        if verified.writes_tests and verified.report is not None:
            from colony.verify.contracts.results import refutation

            new = [b for b in verified.report.breaches if b.contract.name not in verified.refuted_names]
            append_tests(verified.file, program, [refutation(program, breach) for breach in new])
