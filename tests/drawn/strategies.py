"""Hypothesis strategies for programs and runs, on which everything that executes programs is tried.

Programs are valid by construction and shrink towards small ones. `run_of_seed` draws without hypothesis.
"""

from __future__ import annotations

from random import Random

from hypothesis import strategies as st

from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.verify.testing.frames import Choices, draw_trace
from colony.verify.testing.strategies import choices
from tests.drawn.networks import draw_network
from tests.drawn.program_text import draw_text

Run = tuple[Program, tuple[Frame, ...]]
"""A program, and frames for it."""


def networks(*, max_modules: int = 6, max_wires: int = 5) -> st.SearchStrategy[Program]:
    """Draw programs that consist of a network: arbitrary wirings of modules controlled by bool sensors.

    The predicate of module `m<i>` is the bool sensor `p<i>`, and the module is silent where that is missing;
    so a trace can produce any pattern of activity. Wirings are directed acyclic graphs over one or two
    actuators, with shared wires, inhibitors of suppressors of inhibitors, and time constants. The contract
    `<name>_is_inactive` of each module and wire is broken whenever that module or wire is active.
    """
    return choices().map(lambda c: draw_network(c, max_modules, max_wires))


def texts(*, python: bool = True) -> st.SearchStrategy[str]:
    """Draw source texts of valid programs that use the whole language except imports and tests.

    With `python`, some modules are written in Python.
    """
    return choices().map(lambda c: draw_text(c, python))


def programs(*, python: bool = True) -> st.SearchStrategy[Program]:
    """Draw the programs of `texts`.

    Raises:
        DiagnosticError: the front end rejects a drawn text, which is a bug in the front end or in `texts`.
    """
    return texts(python=python).map(load_text)


def network_runs(*, max_modules: int = 6, max_wires: int = 5, max_frames: int = 8) -> st.SearchStrategy[Run]:
    """Draw a network together with a trace, which varies more than `networks().flatmap(traces)`."""
    return choices().map(lambda c: _network_run(c, max_modules, max_wires, max_frames))


def runs(*, python: bool = True, max_frames: int = 8) -> st.SearchStrategy[Run]:
    """Draw a program together with a trace, which varies more than `programs().flatmap(traces)`."""
    return choices().map(lambda c: _run(c, python, max_frames))


def run_of_seed(seed: int, *, network: bool = False, max_frames: int = 8, sequence: bool = False) -> Run:
    """Return a run that `runs` (or `network_runs`) could draw, determined by the seed, without hypothesis.

    With `sequence` its program has one.
    """
    c = Choices(Random(seed))
    return _network_run(c, 6, 5, max_frames) if network else _run(c, True, max_frames, sequence)


def _network_run(c: Choices, max_modules: int, max_wires: int, max_frames: int) -> Run:
    program = draw_network(c, max_modules, max_wires)
    return program, draw_trace(c, program, max_frames)


def _run(c: Choices, python: bool, max_frames: int, sequence: bool = False) -> Run:
    program = load_text(draw_text(c, python, sequence))
    return program, draw_trace(c, program, max_frames)
