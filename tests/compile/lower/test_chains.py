"""Wherever a long chain of lets is read first: lowering does not recurse over it."""

from __future__ import annotations

import pytest

from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.needs import clients_view, whole_view

LENGTH = 1500

ROBOT = """
robot r {
  sensor x : number from DServer.x
  actuator out { v : number } to DServer.out idle hold
}
"""
PLACES = {
    "predicate": "module m { when END > 0 do out(v = 1) }",
    "command": "module m { when true do out(v = END) }",
    "let of a module": "module m { let own = END when own > 0 do out(v = 1) }",
    "state of a file": "state s = 0 next s = END module m { when s > 0 do out(v = 1) }",
    "state of a module": "module m { state s = 0 next s = END when s > 0 do out(v = 1) }",
    "transition": (
        "machine p { start a a -> b when END > 0 b -> a when x > 0 } module m { when p == p.a do out(v = 1) }"
    ),
    "limit": "module m { when true do out(v = 1) } limit out.v <= END",
    "condition of a limit": "module m { when true do out(v = 1) } limit out.v <= 3 when END > 0",
    "contract": "module m { when true do out(v = 1) } contract c: END > out.v",
    "Python": 'module m { when true do out(v = 1) } module p from python "a:B" { reads END }',
    "gate": "module m { when true do out(v = 1) } module n { when END > 0 }",
}


@pytest.mark.parametrize("place", PLACES)
def test_a_long_chain_read_first_in(place: str) -> None:
    lets = "".join(f"let g{i} = g{i - 1} + 1\n" if i else "let g0 = x\n" for i in range(LENGTH))
    network = "n inhibits m" if place == "gate" else "m"
    text = f"{ROBOT}{lets}{PLACES[place].replace('END', f'g{LENGTH - 1}')}\nnetwork {{ out = {network} }}\n"
    program = load_text(text)
    clients = compile_program(program).clients
    code = whole_view(lower(program, clients).code)
    assert len(code.ops) > LENGTH
    if place not in ("contract", "Python"):
        assert len(clients_view(lower(program, clients).code, [("out", "m")]).ops) > LENGTH
