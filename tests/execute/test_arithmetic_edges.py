"""The functions on scalars at the edges: nothing there, NaN, zeros, ties."""

from __future__ import annotations

from math import inf, nan

import pytest

from colony.execute import arithmetic as a


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (a.index_of_min(nan, nan), 0.0),
        (a.index_of_max(nan, nan), 0.0),
        (a.index_of_min(nan, 2.0, 1.0, 1.0), 2.0),
        (a.index_of_max(nan, 2.0, 1.0, 2.0), 1.0),
        (a.minimum(2.0, -0.0, 0.0), -0.0),
        (a.minimum(2.0, 0.0, -0.0), 0.0),
        (a.maximum(-2.0, 0.0, -0.0), 0.0),
        (a.minimum(1.0, nan), nan),
        (a.maximum(nan, 1.0), nan),
        (a.divide(1.0, 0.0), inf),
        (a.divide(1.0, -0.0), -inf),
        (a.divide(-1.0, -0.0), inf),
        (a.divide(0.0, 0.0), nan),
        (a.divide(nan, 0.0), nan),
        (a.divide(6.0, 4.0), 1.5),
        (a.modulo(-7.0, 3.0), 2.0),
        (a.modulo(7.0, 0.0), nan),
        (a.sign_of(-0.0), 0.0),
        (a.round_even(2.5), 2.0),
        (a.round_down(-0.0), -0.0),
        (a.round_up(-0.5), -0.0),
        (a.pick_number((1.0, 2.0, 3.0), -1.0), 3.0),
        (a.pick_number((1.0, 2.0, 3.0), 2.5), 3.0),
        (a.pick_number((1.0, 2.0, 3.0), inf), nan),
        (a.pick_bool((True, False), nan), False),
        (a.total(-0.0), -0.0),
        (a.count(True, False, True), 2.0),
    ],
)
def test_values(found: float, expected: float) -> None:
    assert repr(found) == repr(expected)
