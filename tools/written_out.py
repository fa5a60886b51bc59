"""A program with sequences, held to the same program with them written out as text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from colony.dsl.check.program import without_sequences
from colony.dsl.files import load_tree
from colony.dsl.load import load_text
from colony.ir.frame import Frame, Outcome
from colony.ir.program import Program
from colony.verify.reference.interpreter import Interpreter

_PART = re.compile(r"\bchore\.(\w+)")


def written_out_disagreement(program: Program, trace: Sequence[Frame]) -> str | None:
    """Return the first frame in which a drawn program decides otherwise with its sequence written out."""
    text = program.files[-1][1].text
    other = load_text(without_sequences(load_tree(Path("<text>"), "<text>", text)))
    mine, theirs = Interpreter(program), Interpreter(other)
    for frame in trace:
        renamed = {_renamed(name): value for name, value in frame.readings.items()}
        taken = {_renamed(name): value for name, value in frame.taken_ns.items()}
        expected = _outcome(mine.step(frame))
        found = _outcome(theirs.step(frame._replace(readings=renamed, taken_ns=taken)))
        if expected != found:
            return f"written out, at {frame.t_ns / 1e9:g} s: {found}\n  expected: {expected}\n{text}"
    return None


def _renamed(name: str) -> str:
    return _PART.sub(r"chore_\1", name)


def _outcome(outcome: Outcome) -> str:
    return _renamed(repr(outcome))
