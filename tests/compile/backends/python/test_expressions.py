"""The code of one client depends on others, of whom generated Python knows nothing."""

from __future__ import annotations

import pytest

from colony.compile.backends.python.expressions import ExpressionTexts
from colony.compile.backends.python.plan import ROOT, FunctionLayout, Placement
from colony.compile.backends.python.text import UniqueNames, ranges
from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.code import Lost, PythonActive
from colony.execute.needs import clients_view

TEXT = """
robot r {
  sensor b : bool from DServer.b
  actuator out { v : number } to DServer.out idle out(v = 0) on_loss degrade
}
module p from python "a:B" { reads b commands out }
module n { when b do out(v = 2) }
module m { when true do out(v = 1) }
network { out = %s suppresses m }
"""


@pytest.mark.parametrize(("above", "kind"), [("p", PythonActive), ("n", Lost)])
def test_what_others_do_has_no_text(above: str, kind: type) -> None:
    program = load_text(TEXT % above)
    code = clients_view(lower(program, compile_program(program).clients).code, [("out", "m")])
    at = next(i for i, op in enumerate(code.ops) if isinstance(op, kind))
    layout, known = FunctionLayout(), ranges(code)
    placement = Placement(code, layout, known)
    placement.use(at, layout.slot(ROOT))
    placement.settle(layout.slot(ROOT))
    with pytest.raises(ValueError, match=r"^the code of a single client is not for this backend$"):
        ExpressionTexts(code, placement, known, UniqueNames(code, frozenset()))
