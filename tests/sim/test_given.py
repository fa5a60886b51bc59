"""What is given for fields over time."""

from __future__ import annotations

from colony.sim.mechanism import GivenTimeline, nothing_given


def test_a_value_holds_until_the_next_in_whatever_order_they_are_given() -> None:
    timeline = GivenTimeline()
    timeline.add("Panel", "estop", 20, False)
    timeline.add("Panel", "estop", 10, True)
    timeline.add("Panel", "estop", 30, "missing")
    timeline.add("Panel", "estop", 20, "missing")
    timeline.add("Lift", "load", 5, 2.5)
    timeline.add("Lift", "load", 7, None)
    found = [timeline.value_at("Panel", "estop", t_ns) for t_ns in (0, 9, 10, 19, 20, 29, 30, 99)]
    assert found == [None, None, True, True, "missing", "missing", "missing", "missing"]
    assert [timeline.value_at("Lift", "load", t_ns) for t_ns in (4, 5, 6, 7)] == [None, 2.5, 2.5, None]
    assert timeline.value_at("Lift", "estop", 10) is None
    assert timeline.size == 6
    assert nothing_given("Panel", "estop", 10) is None
