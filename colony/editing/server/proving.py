"""Verdicts of tests and contracts, as lenses show them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace

from colony.editing.analysis import Analyzer, finding_of, fixes_of
from colony.editing.server.jobs import ProofVerdict, ProveAnswer, ProveJob
from colony.extras import installed
from colony.ir import program as ir
from colony.text.diagnostics import Diagnostic, render
from colony.verify.lints.proof import has_python_modules
from colony.verify.testing.examples import ExampleResult, failures_as_diagnostics, run_examples

_LINT_SHARE = 0.5
"""Share of the work for contracts that goes to what can never act."""


def verdicts(job: ProveJob, analyzer: Analyzer) -> Iterator[ProofVerdict | ProveAnswer]:
    """Run the tests of a program and prove its contracts; those of other files are left to these files.

    Tests of a program with modules in Python run only when asked for by name: they run the user's code.
    """
    analyzed = analyzer.analyze(job.program.path, job.program.texts, job.program.robot)
    program = analyzed.program
    if program is None:
        yield ProveAnswer(job.number, refusal="the file has errors")
        return
    source = program.files[-1][1]
    found: list[Diagnostic] = []
    if job.test or not has_python_modules(program):
        tests = tuple(t for t in program.tests if job.test in ("", t.name))
        for result in run_examples(replace(program, tests=tests)):
            yield _of_test(job.number, result)
            found += failures_as_diagnostics([result])
    if not job.test and installed("z3"):
        yield from _of_contracts(job, program, found)
    paths = {id(source): job.program.path}
    tree = analyzed.tree
    kept = [d for d in found if id(d.span.source) in paths]
    yield ProveAnswer(job.number, [finding_of(d, paths, fixes_of(d, tree)) for d in kept])


def _of_test(number: int, result: ExampleResult) -> ProofVerdict:
    failures = [render(d) for d in failures_as_diagnostics([result])]
    word = "passed" if result.passed else "FAILED"
    return ProofVerdict(number, "test", result.name, word, not result.passed, "\n".join([word, *failures]))


def _of_contracts(job: ProveJob, program: ir.Program, found: list[Diagnostic]) -> Iterator[ProofVerdict]:
    """Yield the verdicts of the contracts and reaches of the file, and add what is wrong to `found`."""
    from colony.verify.contracts.example_block import example_block
    from colony.verify.contracts.kept import ProofCache, cache_folder
    from colony.verify.contracts.prove import results
    from colony.verify.contracts.report import finding, lines, verdict
    from colony.verify.contracts.results import ProofOptions, Proved, Refuted, with_reaches
    from colony.verify.contracts.solver import Deadline
    from colony.verify.lints import Effort, lint

    options = ProofOptions.within(job.seconds, depth=4, in_all=True)
    asked, source = with_reaches(program), program.files[-1][1]
    own = [*program.contracts, *program.reaches]
    names = [c.name for c in own if c.span.source is source and not c.assumed]
    cache = ProofCache(cache_folder(os.environ), asked, options, names)
    shapes: dict[str, object] = {}
    for result in results(asked, names, options, shapes, cache, None, Deadline(options.total), 1):  # type: ignore[arg-type]
        is_good = isinstance(result, Refuted) if result.contract.reach else not isinstance(result, Refuted)
        is_bad = not is_good or (result.contract.reach and isinstance(result, Proved))
        block = example_block(program, result.contract, result.trace) if isinstance(result, Refuted) else None
        details = "\n".join(lines(program, result))
        yield ProofVerdict(
            *(job.number, "contract", result.contract.name, verdict(result), is_bad, details, block or "")
        )
        diagnostic = finding(result, None)
        found += [diagnostic] if diagnostic is not None else []
    known = cache.found("lints", tuple)
    if known is None:
        effort = Effort(round(options.resources * _LINT_SHARE))
        required = ir.without_assumed(program)
        known = lint(required, effort, shapes), effort.questions_skipped  # type: ignore[arg-type]
        cache.keep_found("lints", known)
    found += [f.diagnostic for f in known[0]]
