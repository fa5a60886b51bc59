"""The work and the output of `colony verify --examples`.

Drawn traces go through every executor, including the runtime in virtual time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from colony.cli.sarif import TraceStep
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.text.diagnostics import Diagnostic, error
from colony.text.source import Span
from colony.text.wording import counted
from colony.verify.snapshot import snapshot_of
from colony.verify.testing.agreement import reference
from colony.verify.testing.differential import Breach, DifferentialReport, Nondeterministic, try_traces


def reports(program: Program, count: int, seed: int, *, faults: bool = False) -> Iterator[DifferentialReport]:
    """Draw `count` traces from `seed`, and yield the results so far after each trace.

    Every trace goes through all executors and the runtime in virtual time; with `faults`, also through a run
    in which processes die and messages get lost.

    Raises:
        DiagnosticError: a Python module cannot be imported or built.
    """
    from colony.analysis.virtual_executor import VirtualExecutor, with_faults
    from colony.verify.testing.agreement import with_c

    return try_traces(
        program,
        count,
        seed,
        executors={**with_c(program), "runtime in virtual time": VirtualExecutor},
        trials={"runtime with faults": with_faults} if faults else {},
    )


# --- text ------------------------------------------------------------------------------------


def lines(
    program: Program, report: DifferentialReport, refuted_names: Collection[str] = ()
) -> tuple[str, ...]:
    """Return the results as text, without traces of contracts that the prover has refuted."""
    text = [_headline(report)]
    if report.disagreement is not None:
        text += ["this is a bug in colony; please report it with the file and the trace:"]
        text += str(report.disagreement).splitlines()
    for breach in report.breaches:
        text.append(f"REFUTED  {breach.contract.name}  (in {counted(breach.frames, 'frame')})")
        if breach.contract.name not in refuted_names:
            text += [f"  {line}" for line in _table(program, breach)]
    return (*text, *_coverage(report)) if report.nondeterministic is None else tuple(text)


def bug(report: DifferentialReport) -> str | None:
    """Return the executors' disagreement as a bug of colony; None if they agree."""
    return None if report.disagreement is None else f"executors disagree: {report.disagreement}"


def _headline(report: DifferentialReport) -> str:
    drawn = f"{counted(report.drawn, 'trace')} of {report.asked}" if report.drawn < report.asked else ""
    what = f"{drawn or counted(report.drawn, 'trace')} with {counted(report.frames, 'frame')}"
    what += f" from seed {report.seed}"
    if report.disagreement is not None:
        return f"{what}: executors DISAGREE"
    if report.nondeterministic is not None:
        return f"{what}: stopped, as {report.nondeterministic.module.name} is not deterministic"
    return f"{what}: all executors agree"


def _table(program: Program, breach: Breach) -> tuple[str, ...]:
    from colony.verify.contracts.results import refutation
    from colony.verify.contracts.table import table

    return table(program, breach.contract, refutation(program, breach).trace)


def _coverage(report: DifferentialReport) -> Iterator[str]:
    """Yield a table with one line per module, and the modules that never won."""
    rows = [("module", "won", "active", "silent")]
    for module in report.modules:
        won = "-" if module.won is None else str(module.won)
        rows.append((module.name, won, str(module.active), str(module.silent)))
    if len(rows) == 1 or not report.drawn:
        return
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    for name, *numbers in rows:
        columns = (number.rjust(w) for number, w in zip(numbers, widths[1:], strict=True))
        yield f"  {name.ljust(widths[0])}  {'  '.join(columns)}"
    if report.never_won:
        yield f"never won in any trace: {', '.join(report.never_won)}"


# --- findings --------------------------------------------------------------------------------------


def findings(
    program: Program, report: DifferentialReport, file: str | None, refuted_names: Collection[str] = ()
) -> dict[Diagnostic, tuple[TraceStep, ...]]:
    """Return the errors that the traces revealed, each with the frames that lead to it.

    There is one for every broken contract, except those that the prover has refuted
    (`refuted_names`), and one for a Python module that is not deterministic. `file` is the file to which
    hints suggest adding tests, if any.
    """
    errors: dict[Diagnostic, tuple[TraceStep, ...]] = {}
    for breach in report.breaches:
        if breach.contract.name not in refuted_names:
            steps = _steps(program, breach.trace, breach.contract.span)
            errors[_broken(program, breach, file)] = steps
    if report.nondeterministic is not None:
        steps = _steps(program, report.nondeterministic.trace, report.nondeterministic.module.span)
        errors[_nondeterministic(report.nondeterministic)] = steps
    return errors


def _broken(program: Program, breach: Breach, file: str | None) -> Diagnostic:
    from colony.verify.contracts.report import finding
    from colony.verify.contracts.results import refutation

    diagnostic = finding(refutation(program, breach), file)
    assert diagnostic is not None, "it is refuted"
    return diagnostic


def _nondeterministic(nondeterministic: Nondeterministic) -> Diagnostic:
    module = nondeterministic.module
    path = f"{module.module_path}:{module.class_name}"
    message = f"`{path}` is not deterministic: two instances gave different answers to the same frames"
    hint = "let `step` depend only on its params and arguments; for randomness read Runtime.random"
    return error("P002", module.span, message, hint)


# --- traces ----------------------------------------------------------------------------------------


def _steps(program: Program, frames: Sequence[Frame], span: Span) -> tuple[TraceStep, ...]:
    """Return a step per frame: its time, the commands of all actuators, and the sensors' values."""
    from colony.verify.contracts.report import readable_frames

    snapshots = (snapshot_of(program, frame)._replace(t_ns=frame.t_ns - frames[0].t_ns) for frame in frames)
    steps = readable_frames(program, snapshots, reference(program, frames))
    return tuple(TraceStep(span, event, values) for event, values in steps)


# --- JSON ----------------------------------------------------------------------------------


def row(program: Program, report: DifferentialReport) -> dict[str, object]:
    """Return an object for JSON, with traces in the prover's form."""
    from colony.verify.contracts.report import trace_rows
    from colony.verify.contracts.results import refutation

    broken = [
        {
            "contract": b.contract.name,
            "frames": b.frames,
            "trace": trace_rows(program, refutation(program, b).trace),
        }
        for b in report.breaches
    ]
    return {
        "seed": report.seed,
        "asked": report.asked,
        "drawn": report.drawn,
        "frames": report.frames,
        "modules": [
            {"module": m.name, "won": m.won, "active": m.active, "silent": m.silent} for m in report.modules
        ],
        "broken": broken,
        "disagreement": None if report.disagreement is None else str(report.disagreement),
        "not_deterministic": None if report.nondeterministic is None else report.nondeterministic.module.name,
    }
