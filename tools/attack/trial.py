"""One attacker against the robot, judged by what came of it."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from colony.runtime.transport.live.gateway import whoami
from tools.attack import attempts
from tools.attack.intruder import REFUSED, STRANGER, Attack, Intruder, attacks
from tools.attack.lab import MARK, SERVED, Lab, Witness
from tools.attack.sockets import beyond_the_gateway

MAY_DRIVE = ("driver", "runner")


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The outcome of an attack. `delivered`, `heard` and `connections` are beyond the attacker's right;
    `within` counts the messages that got through within it. `linked` is True if the link stood in most looks:
    a peer's stands until the gateway has read in which mode it comes, and is then closed."""

    attack: str
    linked: bool
    delivered: tuple[str, ...]
    heard: tuple[str, ...]
    connections: tuple[str, ...]
    moved: bool
    within: int

    @property
    def failed(self) -> bool:
        """True if the attack got nothing beyond its right."""
        return not (self.delivered or self.heard or self.connections or self.moved)


def impersonators(lab: Lab, mode: str) -> list[Intruder]:
    """Return strangers that come under the ids of zenoh of the robot's processes, one for each."""
    witness = Witness(lab.machine)
    try:
        processes = witness.processes()
    finally:
        witness.close()
    return [Intruder(mode=mode, certificate=STRANGER, process=process) for process in sorted(processes)]


def attempt(intruder: Intruder, lab: Lab, folder: Path, *, watch_s: float) -> Outcome:
    """Let an attacker try everything, and watch what happens for `watch_s` seconds."""
    witness = Witness(lab.machine)
    connections: set[str] = set()
    heard: list[tuple[str, str]] = []
    looks: list[bool] = []
    moved = False
    drives = intruder.certificate not in MAY_DRIVE
    try:
        with attacks(intruder, lab, folder) as attack:
            if attack is not None:
                attempts.listen(attack)
                attempts.send(attack)
                if drives:
                    attempts.drive(attack)
                end = time.monotonic() + watch_s
                while True:
                    connections |= _connections(lab, attack, witness)
                    moved |= drives and lab.machine.moves()
                    looks.append(bool(_links(attack, witness)))
                    if time.monotonic() > end:
                        break
                    time.sleep(0.05)
                witness.asks()
                _behind_it(lab)
                heard = list(attack.heard)
        got = list(witness.got)
    finally:
        witness.close()
    return Outcome(
        attack=f"{intruder.mode}, {intruder.certificate}{' as a process' if intruder.process else ''}",
        linked=2 * sum(looks) > len(looks),
        delivered=_sorted(f"{kind} {key}" for kind, key in got if not _may(intruder.user, kind, key)),
        heard=_sorted(
            f"{kind} {key}"
            for kind, key in heard
            if MARK.decode() not in key and not attempts.may_hear(intruder.user, kind, key)
        ),
        connections=tuple(sorted(connections)),
        moved=moved,
        within=sum(_may(intruder.user, kind, key) for kind, key in got),
    )


def _may(user: str, kind: str, key: str) -> bool:
    if kind == "token":
        return attempts.may_claim(user, key)
    return kind == "put" and attempts.may_send(user, key)


def _connections(lab: Lab, attack: Attack, witness: Witness) -> set[str]:
    """Return sockets that no process of the robot may have, and links to the attacker that must not exist."""
    found = {
        f"{s.process} {s.protocol} {s.local}>{s.remote}" for s in beyond_the_gateway(lab.pids(), lab.port)
    }
    links = _links(attack, witness)
    if attack.intruder.certificate in REFUSED and links:
        found.add("the gateway lets it in")
    if len(links) > 1:
        found.add(f"linked to {len(links)} processes")
    return found


def _links(attack: Attack, witness: Witness) -> set[str]:
    """Return the ids of the robot's processes that the attacker is linked to."""
    info = attack.session.info
    return {str(zid) for zid in (*info.routers_zid(), *info.peers_zid())} & witness.processes()


def _behind_it(lab: Lab) -> None:
    """Check that an honest user is served, who has to wait behind the attack, and that no server is lost."""
    with lab.session("ada") as session, session.connect("Gateway") as gateway:
        assert gateway.do(whoami()).user == "ada"
        assert set(SERVED) <= set(session.servers())


def _sorted(found: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(set(found)))
