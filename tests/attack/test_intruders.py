"""Strangers get nothing through, hear nothing, and no process of the robot connects to them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sampling import sampled
from tests.waiting import until
from tools.attack.intruder import MODES, REFUSED, STRANGER, Intruder, scouted
from tools.attack.lab import Lab, Witness
from tools.attack.sockets import Socket, network_sockets
from tools.attack.trial import attempt, impersonators

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


@pytest.mark.parametrize(
    "intruder", sampled(SAMPLE, every=3, thorough=True), ids=lambda i: f"{i.mode}-{i.certificate}"
)
def test_nobody_gets_beyond_the_right(intruder: Intruder, lab: Lab, folder: Path) -> None:
    outcome = attempt(intruder, lab, folder, watch_s=WATCH_S)
    assert outcome.failed, outcome
    let_in = intruder.mode != "peer" and intruder.certificate not in REFUSED
    assert outcome.linked == let_in, "the attack took place as it was meant"
    has_a_right = let_in and intruder.certificate != STRANGER
    if has_a_right and not outcome.within:  # on a busy machine what it may do takes longer to arrive
        outcome = attempt(intruder, lab, folder, watch_s=8 * WATCH_S)
        assert outcome.failed, outcome
    assert (outcome.within > 0) == has_a_right, "else the witness would be deaf"


@pytest.mark.thorough
@pytest.mark.parametrize("mode", MODES)
def test_nobody_passes_for_a_process_of_the_robot(mode: str, lab: Lab, folder: Path) -> None:
    """Two links of one id are one to zenoh, and the first one's rights would be those of both."""
    for intruder in impersonators(lab, mode):
        outcome = attempt(intruder, lab, folder, watch_s=0.2)
        assert outcome.failed, outcome


def test_nobody_answers_a_call_to_everybody(lab: Lab) -> None:
    witness = Witness(lab.machine)
    try:
        assert len(witness.processes()) > 1
        assert not scouted(0.5) & witness.processes()
    finally:
        witness.close()


def test_the_sockets_of_the_robot(lab: Lab) -> None:
    with lab.session("ada"):
        found = until(lambda: _gateway_has_two(lab), "the gateway listens, and took the session")
    assert {s.process for s in found} == {"Gateway"}
    assert {s.local for s in found} == {lab.port}


def _gateway_has_two(lab: Lab) -> list[Socket] | None:
    found = list(network_sockets(lab.pids()))
    return found if len(found) >= 2 else None
