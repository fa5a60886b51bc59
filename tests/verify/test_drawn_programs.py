"""A sample of `make agreement`."""

from __future__ import annotations

import pytest

from tests.sampling import sampled
from tests.verify.drawn_programs import verdicts


@pytest.mark.parametrize("seed", sampled(range(2, 42), every=4))
def test_drawn_traces_show_what_is_said_of_contracts(seed: int) -> None:
    _, findings = verdicts(seed)
    assert not findings
