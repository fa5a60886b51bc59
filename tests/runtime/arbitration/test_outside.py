"""Who commands from outside: an order without ties, and leases that end."""

from __future__ import annotations

import math

import pytest

from colony.runtime.arbitration.motion import STILL, ConstantSpeeds
from colony.runtime.arbitration.outside import LONGEST_LEASE_S, Outsiders, lease_end
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.connections import Caller

PLACES = {3: "back_off", 1: "cruise"}


def caller(name: str, priority: int) -> Caller:
    return Caller(f"user/{name}", name, priority, "user")


def test_the_order_is_that_of_priorities_and_nobody_shares_one() -> None:
    outsiders = Outsiders()
    for name, priority in (("low", -1), ("high", 9), ("middle", 2)):
        outsiders.enter(caller(name, priority), PLACES)
    assert [c.caller.name for c in outsiders.all] == ["high", "middle", "low"]
    assert outsiders.enter(caller("high", 9), PLACES) is outsiders.all[0]
    with pytest.raises(RefusedError, match=r"priority 9 is taken: high \(user/high\) commands with it"):
        outsiders.enter(caller("other", 9), PLACES)
    with pytest.raises(RefusedError, match="priority 3 is taken: `back_off`, a client of the program,"):
        outsiders.enter(caller("other", 3), PLACES)


def test_who_leaves_frees_the_priority_and_only_its_own() -> None:
    outsiders = Outsiders()
    outsiders.enter(caller("ann", 9), PLACES)
    outsiders.leave(caller("bob", 9))
    assert [c.caller.name for c in outsiders.all] == ["ann"]
    outsiders.leave(caller("ann", 9))
    outsiders.leave(caller("ann", 9))
    assert outsiders.enter(caller("bob", 9), PLACES).caller.name == "bob"


def test_a_command_ends_with_its_lease_and_one_without_does_not() -> None:
    outsiders = Outsiders()
    leased, lasting = (outsiders.enter(caller(n, p), {}) for n, p in (("ann", 2), ("bob", 1)))
    leased.motion = lasting.motion = ConstantSpeeds(speeds=STILL)
    leased.until_ns = lease_end(0.5, 1000)
    outsiders.expire(500_000_999)
    assert outsiders.commanding == (leased, lasting)
    outsiders.expire(500_001_000)
    assert outsiders.commanding == (lasting,)


def test_a_network_with_the_priority_of_somebody_outside_is_a_tie() -> None:
    outsiders = Outsiders()
    outsiders.enter(caller("ann", 3), {})
    assert outsiders.tied({1: "cruise"}) is None
    assert outsiders.tied(PLACES) == "`back_off` has priority 3, with which ann (user/ann) commands"


@pytest.mark.parametrize("lease_s", [0.0, -0.1, math.inf, -math.inf, math.nan, LONGEST_LEASE_S + 0.1])
def test_a_lease_is_positive_and_finite(lease_s: float) -> None:
    with pytest.raises(RefusedError, match="expected more than 0 and at most 60 s"):
        lease_end(lease_s, 0)


def test_the_shortest_lease_is_one_all_the_same() -> None:
    assert lease_end(1e-12, 5) == 6
    assert lease_end(LONGEST_LEASE_S, 0) == 60_000_000_000
