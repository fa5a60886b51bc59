"""What several connections give for fields, and take back."""

from __future__ import annotations

import pytest

from colony.sim.plant import hardware
from colony.sim.plant.hardware import GivenFields


def test_the_newest_giver_counts_until_it_withdraws() -> None:
    fields, first, second = GivenFields(), object(), object()
    of_first_robot, of_second_robot = fields.of(0), fields.of(1)
    fields.give(first, 0, "Panel", "estop", 10, True)
    assert [of_first_robot("Panel", "estop", t_ns) for t_ns in (9, 10)] == [None, True]
    assert of_second_robot("Panel", "estop", 10) is None
    fields.give(second, 0, "Panel", "estop", 20, False)
    fields.give(first, 0, "Panel", "estop", 30, True)
    fields.give(first, 1, "Panel", "estop", 30, "missing")
    assert [of_first_robot("Panel", "estop", t_ns) for t_ns in (19, 20, 30)] == [True, False, False]
    fields.withdraw(second)
    assert [of_first_robot("Panel", "estop", t_ns) for t_ns in (19, 20, 30)] == [True, True, True]
    fields.withdraw(first)
    assert of_first_robot("Panel", "estop", 30) is None
    assert of_second_robot("Panel", "estop", 30) is None


def test_what_is_given_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hardware, "MAX_GIVEN", 2)
    fields = GivenFields()
    fields.give(1, 0, "Panel", "estop", 10, True)
    fields.give(2, 0, "Panel", "estop", 10, True)
    with pytest.raises(ValueError, match="more than 2 changes"):
        fields.give(3, 0, "Panel", "estop", 10, True)
    fields.withdraw(1)
    fields.give(3, 0, "Panel", "estop", 10, True)
