"""Every way to execute a program, held to the reference interpreter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from colony.dsl.load import load_text
from colony.ir.frame import Frame, Outcome
from colony.ir.program import Program
from colony.verify.testing.agreement import EXECUTORS, Factory, disagreement, reference


def outcomes(
    of: str | Program, trace: Sequence[Frame], executors: Mapping[str, Factory] = EXECUTORS
) -> tuple[Outcome, ...]:
    """Return what the interpreter decides in each frame, after all executors have decided the same."""
    program = load_text(of) if isinstance(of, str) else of
    expected = reference(program, trace)
    found = disagreement(program, trace, executors, expected)
    assert found is None, str(found)
    return expected
