"""What programs mean, by hand, in every executor: see `frames.py` for how the cases are written."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.case_files import Case, cases, table
from tests.semantics.frames import literal, told, values

CASES = Path(__file__).parent / "cases"


@pytest.mark.parametrize("case", cases(CASES))
def test_case(case: Case) -> None:
    case.check(told(case.given))


@pytest.mark.parametrize(("given", "expected"), table(CASES / "functions.table"))
def test_function(given: str, expected: str) -> None:
    """Functions and operators, down to NaN and the sign of zero."""
    expression, _, readings = given.partition("|")
    rows = [one.split("=") for one in readings.split()]
    (found,) = values(f"let it = {expression}\n", rows or [["t", "0"]])
    assert repr(found) == repr(literal(expected))
