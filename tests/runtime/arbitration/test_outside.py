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


Commanders = OutsideCommanders[Motion]


@pytest.fixture
def commanders() -> Commanders:
    return Commanders()


def test_the_order_is_that_of_priorities(commanders: Commanders) -> None:
    for name, priority in (("low", -1), ("high", 9), ("middle", 2)):
        commanders.enter(caller(name, priority), PLACES)
    assert [c.caller.name for c in commanders.all] == ["high", "middle", "low"]
    assert commanders.enter(caller("high", 9), PLACES) is commanders.all[0]
    assert commanders.find(caller("high", 9)) is commanders.all[0]
    assert commanders.find(caller("other", 9)) is None
    assert commanders.find(caller("high", 8)) is None


def test_nobody_shares_a_priority(commanders: Commanders) -> None:
    commanders.enter(caller("ann", 9), PLACES)
    commanders.enter(caller("joe", 3), {})
    for priority, places, holder in (
        (9, PLACES, "ann (user/ann)"),
        (1, PLACES, "`cruise`, a client of the program,"),
        (3, PLACES, "joe (user/joe)"),  # who was there before the client
    ):
        with pytest.raises(RefusedError) as refused:
            commanders.enter(caller("bob", priority), places)
        found = refused.value.problem
        assert found.code == "tie"
        assert found.message == (
            f"priority {priority} is taken: {holder} commands with it; open the connection with another"
        )
    assert commanders.enter(caller("joe", 3), PLACES) is commanders.all[1]


def test_who_leaves_frees_the_priority_and_only_its_own(commanders: Commanders) -> None:
    commanders.enter(caller("ann", 9), PLACES)
    commanders.leave(caller("bob", 9))
    assert [c.caller.name for c in commanders.all] == ["ann"]
    commanders.leave(caller("ann", 9))
    commanders.leave(caller("ann", 9))
    assert commanders.enter(caller("bob", 9), PLACES).caller.name == "bob"


def test_a_command_ends_with_its_lease_and_one_without_does_not(commanders: Commanders) -> None:
    leased, lasting = (commanders.enter(caller(n, p), {}) for n, p in (("ann", 2), ("bob", 1)))
    assert (leased.command, leased.lease_end_ns, leased.call_id) == (None, None, None)
    assert commanders.commanding == ()
    leased.command = lasting.command = ConstantSpeeds(speeds=STILL)
    leased.lease_end_ns = lease_end(0.5, 1000)
    commanders.expire(500_000_999)
    assert commanders.commanding == (leased, lasting)
    commanders.expire(500_001_000)
    assert commanders.commanding == (lasting,)
    assert (leased.command, leased.lease_end_ns) == (None, None)
    assert commanders.all == (leased, lasting)


def test_a_network_with_the_priority_of_somebody_outside_is_a_tie(commanders: Commanders) -> None:
    commanders.enter(caller("ann", 3), {})
    assert commanders.find_tie({}) is commanders.find_tie({1: "cruise"}) is None
    assert commanders.find_tie(PLACES) == "`back_off` has priority 3, with which ann (user/ann) commands"


@pytest.mark.parametrize("lease_s", [0.0, -0.1, math.inf, -math.inf, math.nan, MAX_LEASE_S + 1e-6])
def test_a_lease_is_positive_and_finite(lease_s: float) -> None:
    with pytest.raises(RefusedError) as refused:
        lease_end(lease_s, 0)
    text = f"a lease of {lease_s:g} s; expected more than 0 and at most 60 s"
    assert (refused.value.problem.code, refused.value.problem.message) == ("arguments", text)


@pytest.mark.parametrize(
    ("lease_s", "now_ns", "end_ns"),
    [(1e-12, 5, 6), (1e-9, 3, 4), (2.6e-9, 0, 3), (1.0, 3, 1_000_000_003), (MAX_LEASE_S, 3, 60_000_000_003)],
)
def test_a_lease_ends_at_the_nearest_nanosecond_after_now(lease_s: float, now_ns: int, end_ns: int) -> None:
    assert lease_end(lease_s, now_ns) == end_ns
