"""What programs mean, by hand, in every executor: see `frames.py` for how the cases are written."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from colony.compile.backends.c.native import is_available
from colony.verify.testing.agreement import ALL_EXECUTORS, Factory, generated_c
from tests.case_files import Case, cases, table
from tests.semantics.frames import literal, told, values

CASES = Path(__file__).parent / "cases"


IN_C = {"generated C": generated_c}

in_c = pytest.mark.skipif(not is_available(), reason="no C compiler, or no cffi")


@pytest.mark.parametrize("case", cases(CASES))
def test_case(case: Case) -> None:
    case.check(told(case.given))


@in_c
@pytest.mark.thorough
@pytest.mark.parametrize("case", cases(CASES))
def test_case_in_c(case: Case) -> None:
    case.check(told(case.given, IN_C))


@pytest.mark.parametrize(("given", "expected"), table(CASES / "functions.table"))
def test_function(given: str, expected: str) -> None:
    """Functions and operators, down to NaN and the sign of zero."""
    _expect_value(given, expected, ALL_EXECUTORS)


@in_c
@pytest.mark.thorough
@pytest.mark.parametrize(("given", "expected"), table(CASES / "functions.table"))
def test_function_in_c(given: str, expected: str) -> None:
    _expect_value(given, expected, IN_C)


def _expect_value(given: str, expected: str, executors: Mapping[str, Factory]) -> None:
    expression, _, readings = given.partition("|")
    rows = [one.split("=") for one in readings.split()]
    (found,) = values(f"let it = {expression}\n", rows or [["t", "0"]], executors)
    assert repr(found) == repr(literal(expected))
