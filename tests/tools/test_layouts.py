"""A sample of `tools.layouts`."""

from __future__ import annotations

import pytest

from tools.layouts.comparing import compare


@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(51, id="the Clock and the clients restart, the leader leaves and returns"),
        pytest.param(90, id="DServer, the clients of a module in Python and a sensor restart around a stop"),
    ],
)
def test_a_robot_in_one_host_and_one_with_a_host_for_each_part_are_equal(seed: int) -> None:
    counts, findings = compare(seed, ("run", "isolated"))
    assert not findings
    assert counts["frames"] > 10
