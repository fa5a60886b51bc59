"""A program with sequences, held to the same program with them written out as text."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from colony.dsl.check.program import without_sequences
from colony.dsl.files import load_tree
from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.ir.program import Machine, Program
from colony.verify.reference.interpreter import Interpreter


def drawn_disagreement(program: Program, trace: Sequence[Frame]) -> str | None:
    """Return the first frame in which a drawn program decides otherwise with its sequence written out."""
    text = program.files[-1][1].text
    other = load_text(without_sequences(load_tree(Path("<text>"), "<text>", text)))
    found = written_out_disagreement(program, other, trace)
    return None if found is None else f"{found}\n{text}"


def written_out_disagreement(program: Program, other: Program, trace: Sequence[Frame]) -> str | None:
    """Return the first frame in which `other`, in which the sequences are written out, decides otherwise."""
    names = [d.name for d in program.derived if isinstance(d, Machine) and d.tasks and "." not in d.name]
    renamed = partial(re.sub, rf"\b({'|'.join(names)})\.(\w+)", r"\1_\2")
    mine, theirs = Interpreter(program), Interpreter(other)
    for frame in trace:
        expected = renamed(repr(mine.step(frame)))
        found = repr(theirs.step(_renamed(frame, renamed)))
        if expected != found:
            return f"written out, at {frame.t_ns / 1e9:g} s: {found}\n  expected: {expected}"
    return None


def _renamed(frame: Frame, renamed: Callable[[str], str]) -> Frame:
    readings = {renamed(name): value for name, value in frame.readings.items()}
    return frame._replace(
        readings=readings, taken_ns={renamed(name): value for name, value in frame.taken_ns.items()}
    )
