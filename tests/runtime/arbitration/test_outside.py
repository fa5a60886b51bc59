"""Who commands from outside: an order without ties, and leases that end."""

from __future__ import annotations

import math

import pytest

from colony.runtime.arbitration.motion import STILL, ConstantSpeeds, Motion
from colony.runtime.arbitration.outside import MAX_LEASE_S, OutsideCommanders, lease_end
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.connections import Caller

PLACES = {3: "back_off", 1: "cruise"}


def caller(name: str, priority: int) -> Caller:
    return Caller(f"user/{name}", name, priority, "user")


def test_the_order_is_that_of_priorities_and_nobody_shares_one() -> None:
    outside_commanders = OutsideCommanders[Motion]()
    for name, priority in (("low", -1), ("high", 9), ("middle", 2)):
        outside_commanders.enter(caller(name, priority), PLACES)
    assert [c.caller.name for c in outside_commanders.all] == ["high", "middle", "low"]
    assert outside_commanders.enter(caller("high", 9), PLACES) is outside_commanders.all[0]
    with pytest.raises(RefusedError, match=r"priority 9 is taken: high \(user/high\) commands with it"):
        outside_commanders.enter(caller("other", 9), PLACES)
    with pytest.raises(RefusedError, match="priority 3 is taken: `back_off`, a client of the program,"):
        outside_commanders.enter(caller("other", 3), PLACES)


def test_who_leaves_frees_the_priority_and_only_its_own() -> None:
    outside_commanders = OutsideCommanders[Motion]()
    outside_commanders.enter(caller("ann", 9), PLACES)
    outside_commanders.leave(caller("bob", 9))
    assert [c.caller.name for c in outside_commanders.all] == ["ann"]
    outside_commanders.leave(caller("ann", 9))
    outside_commanders.leave(caller("ann", 9))
    assert outside_commanders.enter(caller("bob", 9), PLACES).caller.name == "bob"


def test_a_command_ends_with_its_lease_and_one_without_does_not() -> None:
    outside_commanders = OutsideCommanders[Motion]()
    leased, lasting = (outside_commanders.enter(caller(n, p), {}) for n, p in (("ann", 2), ("bob", 1)))
    leased.command = lasting.command = ConstantSpeeds(speeds=STILL)
    leased.lease_end_ns = lease_end(0.5, 1000)
    outside_commanders.expire(500_000_999)
    assert outside_commanders.commanding == (leased, lasting)
    outside_commanders.expire(500_001_000)
    assert outside_commanders.commanding == (lasting,)


def test_a_network_with_the_priority_of_somebody_outside_is_a_tie() -> None:
    outside_commanders = OutsideCommanders[Motion]()
    outside_commanders.enter(caller("ann", 3), {})
    assert outside_commanders.find_tie({1: "cruise"}) is None
    assert (
        outside_commanders.find_tie(PLACES) == "`back_off` has priority 3, with which ann (user/ann) commands"
    )


@pytest.mark.parametrize("lease_s", [0.0, -0.1, math.inf, -math.inf, math.nan, MAX_LEASE_S + 0.1])
def test_a_lease_is_positive_and_finite(lease_s: float) -> None:
    with pytest.raises(RefusedError, match="expected more than 0 and at most 60 s"):
        lease_end(lease_s, 0)


def test_the_shortest_lease_is_one_all_the_same() -> None:
    assert lease_end(1e-12, 5) == 6
    assert lease_end(MAX_LEASE_S, 0) == 60_000_000_000
