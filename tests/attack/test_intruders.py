"""Strangers get nothing through, hear nothing, and no process of the robot connects to them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.attack.intruder import REFUSED, STRANGER, Intruder
from tests.attack.lab import Lab
from tests.attack.sockets import Socket, network_sockets
from tests.attack.trial import Outcome, attempt
from tests.cli.machine import until

SAMPLE = (
    Intruder(mode="peer", certificate=STRANGER),
    Intruder(mode="router", certificate=STRANGER),
    Intruder(mode="client", certificate=STRANGER),
    Intruder(mode="peer", certificate="other authority"),
    Intruder(mode="client", certificate="none"),
    Intruder(mode="client", certificate="expired"),
    Intruder(mode="client", certificate="reader"),
    Intruder(mode="client", certificate="stopper"),
    Intruder(mode="client", certificate="driver"),
    Intruder(mode="router", certificate="runner"),
)
"""One of each kind; `make attack` has all."""

WATCH_S = 1.5
"""Gossip took less than a second to have local processes dial an address."""


@pytest.mark.parametrize("intruder", SAMPLE, ids=lambda i: f"{i.mode}-{i.certificate}")
def test_nobody_gets_beyond_the_right(intruder: Intruder, lab: Lab, folder: Path) -> None:
    outcome = attempt(intruder, lab, folder, watch_s=WATCH_S)
    assert outcome.failed, outcome
    assert outcome.linked == (intruder.certificate not in REFUSED), "the attack took place as it was meant"
    _what_a_right_lets_through_gets_through(intruder, outcome)


def _what_a_right_lets_through_gets_through(intruder: Intruder, outcome: Outcome) -> None:
    """Else the witness would be deaf, and the test could not fail."""
    has_a_right = intruder.certificate not in (*REFUSED, STRANGER)
    assert (outcome.within > 0) == has_a_right, outcome


def test_the_sockets_of_the_robot(lab: Lab) -> None:
    with lab.session("ada"):
        found = until(lambda: _gateway_has_two(lab), "the gateway listens, and took the session")
    assert {s.process for s in found} == {"Gateway"}
    assert {s.local for s in found} == {lab.port}


def _gateway_has_two(lab: Lab) -> list[Socket] | None:
    found = list(network_sockets(lab.pids()))
    return found if len(found) >= 2 else None
