"""The runtime in virtual time decides as the client list and as the reference interpreter, on every frame."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from colony.analysis.virtual_executor import VirtualExecutor
from colony.compile.pipeline import compile_program
from colony.execute.executor import ProgramExecutor
from colony.ir.program import Program
from colony.verify.testing.agreement import reference
from colony.verify.testing.strategies import traces
from tests.drawn.strategies import networks, programs

QUIET = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)


@pytest.mark.parametrize("drawn", [networks, programs])
@settings(suppress_health_check=QUIET)
@given(data=st.data(), order_seed=st.integers(0, 5), isolate=st.booleans())
def test_whatever_the_order_of_messages_every_frame_is_decided_as_by_the_reference(
    drawn: Callable[[], st.SearchStrategy[Program]], data: st.DataObject, order_seed: int, isolate: bool
) -> None:
    program = data.draw(drawn())
    trace = data.draw(traces(program))
    compilation = compile_program(program)
    expected = repr(reference(program, trace))
    for executor in (
        ProgramExecutor(compilation.compiled),
        VirtualExecutor(compilation, seed=order_seed, isolate=isolate),
    ):
        assert repr(tuple(map(executor.step, trace))) == expected
