"""Fixes survive DServer, and what is no fix is none."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.nav.pose.pose import Fix, MeasurementRow, fix_list, fix_of

numbers = st.floats(allow_nan=False, allow_infinity=False)
fixes = st.builds(
    Fix,
    st.integers(0, 2**62),
    st.lists(st.builds(MeasurementRow, numbers, numbers, numbers, numbers, numbers), max_size=4).map(tuple),
)


@given(fixes)
def test_a_fix_comes_back_as_it_was(fix: Fix) -> None:
    assert fix_of(fix_list(fix)) == fix


@pytest.mark.parametrize("value", [[], [1, 2.0], [1, 0.0, 0.0, 0.0, 0.0], [0.0] * 7])
def test_a_list_that_was_cut_short_is_no_fix(value: list[float]) -> None:
    assert fix_of(value) is None
