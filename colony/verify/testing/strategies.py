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

from itertools import pairwise
from random import Random

from hypothesis import strategies as st

from colony.ir.frame import Frame
from colony.ir.program import Program, expect_program
from colony.verify.testing.agreement import reference
from colony.verify.testing.drawing import Choices
from colony.verify.testing.frames import draw_frame, draw_trace, sensors_read
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
    names = sorted(sensors_read(program))
    drawn = st.integers(0, _MAX_SEED).map(lambda seed: _varied(Choices(Random(seed)), program, max_frames))
    count = max_frames - 1 + len(names)
    kept = st.lists(st.integers(0, _KEPT), min_size=count, max_size=count)
    return st.builds(lambda kept, trace: _reduced(trace, names, kept), kept, drawn)


_MAX_SEED = 2**24 - 1
"""The largest seed of a trace; of a larger range hypothesis mostly draws small numbers, again and again."""

_KEPT = 255
"""The largest of the numbers by which hypothesis leaves out parts of a trace: those at 0."""


_CANDIDATES = 3
"""Number of traces of which the one with the most different decisions is taken."""


def _varied(choices: Choices, program: Program, max_frames: int) -> tuple[Frame, ...]:
    """Return the one of a few drawn traces in which the program decides most differently."""

    def variety(trace: tuple[Frame, ...]) -> tuple[int, int]:
        """Return how often the same modules win with another command, then the number of decisions."""
        outcomes = reference(program, trace)
        winners, texts = (
            [[d.by for d in o.decisions] for o in outcomes],
            [repr(o.decisions) for o in outcomes],
        )
        steps = zip(pairwise(winners), pairwise(texts), strict=True)
        return len({texts for (a, b), texts in steps if a == b and any(a) and texts[0] != texts[1]}), len(
            {*texts}
        )

    return max(
        (draw_trace(choices, program, max_frames, mirrored=True) for _ in range(_CANDIDATES)), key=variety
    )


def _reduced(trace: tuple[Frame, ...], names: list[str], kept: list[int]) -> tuple[Frame, ...]:
    """Return a trace without some frames, but with the last one, and without readings of some sensors.

    `names` are the sensors that the program reads; those of others are left out.
    """
    read = {name for name, number in zip(names, kept, strict=False) if number}
    frames = [f for f, number in zip(trace[:-1], kept[len(names) :], strict=False) if number]
    return tuple(
        frame._replace(readings={n: x if n in read else None for n, x in frame.readings.items()})
        for frame in (*frames, trace[-1])
    )


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
