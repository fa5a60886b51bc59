"""What each pass makes of small wirings, as text: a file a pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.compile.passes.elaborate import elaborate
from colony.compile.passes.eliminate_inhibition import eliminate_inhibition
from colony.compile.passes.forward_traversal import forward_traversal
from tests.case_files import Case, cases
from tests.compile.passes.as_text import clients_view, of_network, of_suppression
from tests.wiring import program

PASSES = {
    "elaborate": lambda text: of_network(elaborate(program(text))),
    "eliminate_inhibition": lambda text: of_suppression(eliminate_inhibition(elaborate(program(text)))),
    "forward_traversal": lambda text: clients_view(
        forward_traversal(eliminate_inhibition(elaborate(program(text))))
    ),
}


@pytest.mark.parametrize("case", cases(Path(__file__).parent / "cases"))
def test_case(case: Case) -> None:
    case.check(PASSES[case.path.stem](case.given))
