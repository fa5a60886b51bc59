"""The front door: from a text to decisions, proofs and recordings. `import colony` has all of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

from colony.text.diagnostics import Failure, error
from colony.text.source import NOWHERE

if TYPE_CHECKING:
    from colony.compile.pipeline import Compilation
    from colony.execute.executor import ProgramExecutor
    from colony.ir.program import Program
    from colony.runtime.recordings.recorded import RecordedFrame, RecordingReader
    from colony.verify.audit.report import AuditReport
    from colony.verify.contracts.results import Result as ContractResult
    from colony.verify.difference.results import Result as Difference

PROOF_TIMEOUT_S = 60.0
"""Seconds that z3 may think about one question of a proof."""


def load(path: str | PathLike[str]) -> Program:
    """Check the file at `path`, with everything that it imports, and return its program.

    Raises:
        Failure: with all diagnostics, if there is an error among them.
    """
    from colony.dsl.load import load_file

    return load_file(str(path))


def loads(text: str, name: str = "<text>", directory: str | PathLike[str] = ".") -> Program:
    """Check a text and return its program; messages call it `name`, imports are relative to `directory`.

    Raises:
        Failure: with all diagnostics, if there is an error among them.
    """
    from colony.dsl.load import load_text

    return load_text(text, name, str(directory))


def build(program: Program, *, proof: bool = True, timeout_s: float = PROOF_TIMEOUT_S) -> Build:
    """Compile a program to prioritized clients, and prove that they are its network.

    Args:
        program: what `load` or `loads` gave.
        proof: whether to prove it, which takes a fraction of a second for a hundred modules.
        timeout_s: seconds that z3 may think about one question.

    Raises:
        Failure: V001, the clients are not the network (a mistake of the compiler); V002, that is not decided
            in time.
    """
    from colony.compile.pipeline import compile_program

    compilation = compile_program(program)
    if proof:
        _expect_proof(program, compilation, round(1000 * timeout_s))
    return Build(program=program, compilation=compilation)


def _expect_proof(program: Program, compilation: Compilation, timeout_ms: int) -> None:
    from colony.verify.equivalence import results
    from colony.verify.equivalence.prove import prove as prove_clients

    match prove_clients(program, compilation, timeout_ms=timeout_ms):
        case results.Proved():
            return
        case results.Undecided() as undecided:
            raise Failure([error("V002", NOWHERE, results.undecided_text(undecided))])
        case wrong:
            raise Failure([error("V001", NOWHERE, results.counterexample_text(wrong))])


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """A compiled program, in all forms. `compilation` has the result of each pass of the compiler."""

    program: Program
    compilation: Compilation

    def table(self) -> str:
        """Return the clients as a table for people: priorities and guards."""
        from colony.compile.backends.table import client_table

        return client_table(self.compilation)

    def to_json(self) -> str:
        """Return the clients in the form `colony-clients/1`."""
        from colony.compile.backends.json import to_json

        return to_json(self.compilation.clients)

    def to_python(self) -> str:
        """Return a module with a class `Program`, which needs nothing of colony.

        `Program().step(t_ns, readings, taken_ns)` decides a frame, as `executor().step` does.
        """
        from colony.compile.backends.python.generate import generate

        return generate(self.compilation.compiled)

    def graph(self) -> str:
        """Return a picture of the network, as SVG."""
        from colony.view.graph.graph import to_svg

        return to_svg(self.program)

    def executor(self) -> ProgramExecutor:
        """Return an executor with initial memory, whose `step` takes one frame after another.

        Raises:
            Failure: P001, a module in Python cannot be imported or built.
        """
        from colony.execute.executor import ProgramExecutor

        return ProgramExecutor(self.compilation.compiled)


def prove(program: Program, *, seconds: float = 10.0, depth: int = 4) -> tuple[ContractResult, ...]:
    """Prove each contract for everything that sensors can give, or find the shortest run that breaks it.

    Args:
        program: what `load` or `loads` gave.
        seconds: about how long to try, for each contract.
        depth: the greatest k of k-induction.

    Returns:
        A `Proved`, `Refuted` or `Unknown` (of `colony.verify.contracts.results`) for each contract, in the
        order written.
    """
    from colony.verify.contracts.prove import prove_contracts
    from colony.verify.contracts.results import Options

    return prove_contracts(program, Options.within(seconds, depth=depth))


def compare(one: Program, other: Program) -> Difference:
    """Prove that two programs send the same in every frame, or find a frame that tells them apart.

    Returns:
        A `Same`, `Different` or `Undecided` of `colony.verify.difference.results`.

    Raises:
        Failure: V040 to V042, they cannot be compared.
    """
    from colony.verify.difference.compare import difference

    return difference(one, other)


def recorded(path: str | PathLike[str], program: Program) -> Iterator[RecordedFrame]:
    """Yield the frames of a recording that are not damaged, each with its verdicts.

    Raises:
        Failure: codes A and F, it is no recording, or of another program.
    """
    with _opened(path) as reader:
        yield from reader.frames(program)


def audit(path: str | PathLike[str], program: Program) -> AuditReport:
    """Decide every frame of a recording again with the reference interpreter.

    Raises:
        Failure: codes A and F, it is no recording, or of another program.
    """
    from colony.verify.audit.audit import audit_recording

    with _opened(path) as reader:
        return audit_recording(program, reader)


@contextmanager
def _opened(path: str | PathLike[str]) -> Iterator[RecordingReader]:
    from colony.runtime.recordings.opening import open_recording, read_recording

    with open_recording(str(path)) as file:
        yield read_recording(file, str(path))
