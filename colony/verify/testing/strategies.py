"""Hypothesis strategies for behaviors and traces, for property tests of your own behaviors.

    from hypothesis import given
    from colony.dsl.load import load_file
    from colony.verify.reference.interpreter import Interpreter
    from colony.verify.testing.strategies import traces

    wander = load_file("wander.colony")

    @given(traces(wander))
    def test_never_rams(trace):
        interpreter = Interpreter(wander)
        for frame in trace:
            assert "never_ram" not in interpreter.step(frame).breaches

Examples are valid by construction and shrink towards small programs, short traces and ordinary readings. They
include what goes wrong in practice: missing and faulty sensors, times a nanosecond off, NaN, wires used
twice.
"""

from __future__ import annotations

from random import Random

from hypothesis import strategies as st

from colony.ir.frame import Frame
from colony.ir.program import Program, expect_program
from colony.verify.testing.drawing import Choices
from colony.verify.testing.frames import draw_frame, draw_trace
from colony.verify.testing.networks import draw_network
from colony.verify.testing.program_text import draw_text


def choices() -> st.SearchStrategy[Choices]:
    """Return a strategy for choices that hypothesis makes and shrinks."""
    return st.randoms(use_true_random=False, note_method_calls=False).map(Choices)


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
    from colony.dsl.load import load_text

    return texts(python=python).map(load_text)


def frames(program: Program, *, t_ns: int = 0) -> st.SearchStrategy[Frame]:
    """Draw a frame of `program` at `t_ns`, in declared units.

    Its readings are near the constants of the program, invalid, or missing.
    """
    expect_program(program)
    return choices().map(lambda c: draw_frame(c, program, t_ns))


def traces(program: Program, *, max_frames: int = 8) -> st.SearchStrategy[tuple[Frame, ...]]:
    """Draw up to `max_frames` frames of `program`, at least one, in declared units.

    Times advance by frame periods and by durations of the program, exactly or a nanosecond off. Readings are
    at, between, and one ulp from the program's constants; they recur, are missing, or have the wrong type,
    length or range. The elements of an array are mostly equal, except for a run of others. Some traces begin
    like a test of the program.
    """
    expect_program(program)
    if max_frames < 1:
        raise ValueError(f"max_frames: found {max_frames}; expected 1 or more")
    return choices().map(lambda c: draw_trace(c, program, max_frames))


def network_runs(*, max_modules: int = 6, max_wires: int = 5, max_frames: int = 8) -> st.SearchStrategy[Run]:
    """Draw a network together with a trace, which varies more than `networks().flatmap(traces)`."""
    return choices().map(lambda c: _network_run(c, max_modules, max_wires, max_frames))


def runs(*, python: bool = True, max_frames: int = 8) -> st.SearchStrategy[Run]:
    """Draw a program together with a trace, which varies more than `programs().flatmap(traces)`."""
    return choices().map(lambda c: _run(c, python, max_frames))


def run_of_seed(seed: int, *, network: bool = False, max_frames: int = 8) -> Run:
    """Return a run that `runs` (or `network_runs`) could draw, determined by the seed, without hypothesis."""
    c = Choices(Random(seed))
    return _network_run(c, 6, 5, max_frames) if network else _run(c, True, max_frames)


def _network_run(c: Choices, max_modules: int, max_wires: int, max_frames: int) -> Run:
    program = draw_network(c, max_modules, max_wires)
    return program, draw_trace(c, program, max_frames)


def _run(c: Choices, python: bool, max_frames: int) -> Run:
    from colony.dsl.load import load_text

    program = load_text(draw_text(c, python))
    return program, draw_trace(c, program, max_frames)
