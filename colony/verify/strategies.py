"""Hypothesis strategies for behaviors and what happens to them, to property-test one's own with.

    from hypothesis import given, strategies as st
    from colony.dsl.load import load_text
    from colony.verify.agreement import disagreement
    from colony.verify.strategies import traces

    program = load_text(Path("wander.colony").read_text())

    @given(traces(program))
    def test_never_drives_forward_while_bumped(trace):
        interpreter = Interpreter(program)
        for frame in trace:
            outcome = interpreter.step(frame)
            assert "never_ram" not in outcome.breaches

What is drawn is valid by construction, shrinks towards small programs, short traces and ordinary readings,
and holds what goes wrong in practice: missing and faulty sensors, times a nanosecond off, NaN, sharing.
"""

from __future__ import annotations

from hypothesis import strategies as st

from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.verify.strategies_frames import drawn_frame, drawn_trace
from colony.verify.strategies_network import network_programs
from colony.verify.strategies_text import program_texts


def networks(*, max_modules: int = 6, max_wires: int = 5) -> st.SearchStrategy[Program]:
    """Programs that are all network: any wiring of modules that are applicable as their sensors say.

    Module `m<i>` is applicable where the bool sensor `p<i>` is true, and silent where that is missing; so a
    trace can drive any pattern of activity. Wirings are directed acyclic graphs over one or two actuators,
    with shared wires, inhibitors of suppressors of inhibitors, and time constants. The contract
    `<name>_is_silent` of each module and wire is broken where it is active.
    """
    return network_programs(max_modules=max_modules, max_wires=max_wires)


def texts(*, python: bool = True) -> st.SearchStrategy[str]:
    """Source texts of valid programs that use all of the language but imports and tests.

    With `python`, some modules are written in Python.
    """
    return program_texts(python=python)


def programs(*, python: bool = True) -> st.SearchStrategy[Program]:
    """Programs as the front end makes them of `texts`.

    Raises:
        Failure: while drawing, if the front end refuses a text; that is a bug in one of the two.
    """
    from colony.dsl.load import load_text  # lark is loaded only where texts are parsed

    return texts(python=python).map(load_text)


def frames(program: Program, *, t_ns: int = 0) -> st.SearchStrategy[Frame]:
    """One frame of `program` at `t_ns`, in declared units: readings near its constants, odd, or missing."""
    return drawn_frame(program, t_ns)


def traces(program: Program, *, max_frames: int = 8) -> st.SearchStrategy[tuple[Frame, ...]]:
    """Up to `max_frames` frames of `program`, at least one.

    Times rise by frames and by the durations that the program waits for, exactly or a nanosecond off.
    Readings come back, go missing, and are of the wrong type, length or range.
    """
    return drawn_trace(program, max_frames)
