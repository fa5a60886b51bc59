"""Times against constants: the nanosecond from which on the float is there."""

from __future__ import annotations

import math
from random import Random

import pytest

from colony.verify.symbolic.numbers import first_ns_reaching


@pytest.mark.parametrize("constant", [0.1, 0.3, 1.0, 2.5, 1e-9, 1e-10, 0.05, 3600.0, 123456.789, 1e12])
def test_it_is_the_first_that_reaches_the_constant(constant: float) -> None:
    found = first_ns_reaching(constant)
    assert found / 1e9 >= constant
    assert (found - 1) / 1e9 < constant


@pytest.mark.parametrize("constant", [0.0, -0.0, -1.0, -math.inf])
def test_all_times_reach_what_is_not_above_zero(constant: float) -> None:
    assert first_ns_reaching(constant) == 0


def test_whole_nanoseconds_reach_themselves() -> None:
    random = Random(1)
    for _ in range(300):
        nanoseconds = random.randrange(1, 10 ** random.randrange(1, 16))
        assert first_ns_reaching(nanoseconds / 1e9) == nanoseconds
