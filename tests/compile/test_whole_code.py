"""What the compiler makes of whole programs, to the letter: the ops, generated Python, and what it tells.

That both mean what they should is for other tests (all executors agree with the reference). These hold what
only reading shows: that no op is computed twice or in vain, that generated Python is plain where it may be
and reads well. After a change on purpose: `python -m tests.compile.test_whole_code`, and read the diff.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colony.compile.backends.explain import explain
from colony.compile.backends.json import to_json
from colony.compile.backends.python.generate import generate
from colony.compile.backends.table import client_table
from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.code import Code
from colony.execute.needs import clients_view, module_view, whole_view
from colony.verify.testing.agreement import client_disagreement, disagreement
from colony.verify.testing.strategies import traces
from tests.compile.listing import listing
from tests.sampling import sampled

LONGEST = 1000
"""Programs with more ops are not listed op by op."""

CASES = sorted((Path(__file__).parent / "cases" / "code").glob("*.colony"))


def made_of(path: Path) -> dict[str, str]:
    """The files beside a program, and what should be in them."""
    program = load_text(path.read_text(), path.name)
    compilation = compile_program(program)
    clients = compilation.clients
    as_json = to_json(clients, compilation.network.failsafe_modules)
    texts = {
        ".explained.txt": "\n\n".join((explain(compilation), client_table(compilation), as_json)),
        ".generated.txt": generate(lower(program, clients)),
    }
    code = lower(program, clients).code
    if len(whole_view(code).ops) < LONGEST:
        texts[".code.txt"] = _listed(code)
    return texts


def _listed(code: Code) -> str:
    parts = [listing(whole_view(code))]
    for one in code.actuators:
        for client in one.clients:
            alone = clients_view(code, [(one.actuator.name, client.module)])
            parts.append(f"--- {client.module} for {one.actuator.name}\n{listing(alone)}")
    for call in code.python:
        alone = module_view(code, call.module)
        parts.append(f"--- {call.module}, which is in Python\n{listing(alone)}")
    return "\n".join(parts)


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_case(path: Path) -> None:
    for suffix, text in made_of(path).items():
        assert text == path.with_suffix(suffix).read_text(), f"{path.stem}{suffix} has changed"


@pytest.mark.parametrize("path", sampled(CASES, every=2), ids=lambda path: path.stem)
@given(data=st.data())
@settings(max_examples=8)
def test_case_does_what_it_says(path: Path, data: st.DataObject) -> None:
    program = load_text(path.read_text(), path.name)
    trace = data.draw(traces(program))
    found = disagreement(program, trace) or client_disagreement(program, trace)
    assert found is None, str(found)


def test_without_contracts_nothing_of_them_is_left() -> None:
    (path,) = (path for path in CASES if path.stem == "memory")
    program = load_text(path.read_text(), path.name)
    clients = compile_program(program).clients
    without = replace(program, contracts=())
    assert "breaches +=" in generate(lower(program, clients))
    assert "breaches +=" not in generate(lower(without, clients))
    assert lower(without, clients).contracts == ()


if __name__ == "__main__":
    for case in CASES:
        for ending, made in made_of(case).items():
            case.with_suffix(ending).write_text(made)
