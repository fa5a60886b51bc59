"""All executors of drawn programs do what the reference does, bit for bit, and so do clients alone."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from colony.compile.backends.python.generate import generate, load
from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.verify.testing.agreement import client_disagreement, disagreement
from colony.verify.testing.strategies import networks, programs, traces


@given(data=st.data())
@settings(max_examples=100)
def test_programs(data: st.DataObject) -> None:
    program = data.draw(programs())
    trace = data.draw(traces(program))
    assert disagreement(program, trace) is None
    assert client_disagreement(program, trace) is None


@given(data=st.data())
@settings(max_examples=100)
def test_networks(data: st.DataObject) -> None:
    program = data.draw(networks())
    trace = data.draw(traces(program))
    assert disagreement(program, trace) is None
    assert client_disagreement(program, trace) is None


@given(data=st.data())
def test_leaving_contracts_out_changes_nothing_else(data: st.DataObject) -> None:
    program = data.draw(programs())
    clients = compile_program(program).clients
    whole = load(generate(lower(program, clients)))
    without = load(generate(lower(replace(program, contracts=()), clients)))
    for frame in data.draw(traces(program)):
        expected, found = whole.step(frame), without.step(frame)
        assert repr(found) == repr(expected._replace(breaches=()))
