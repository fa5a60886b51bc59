"""Attackers: raw sessions of zenoh, in every mode and with every kind of certificate."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from colony.runtime.transport.live.robot_address import Credentials
from tests.runtime.transport.live.certificates import Authority, free_port
from tools.attack.lab import MARK, USERS, Lab

MODES = ("client", "peer", "router")
REFUSED = ("none", "self-signed", "other authority", "expired")
STRANGER = "stranger"
"""The authority signed it, but it is not in the table of users."""
ABUSERS = ("reader", "stopper", "driver", "runner")
CERTIFICATES = (*REFUSED, STRANGER, *ABUSERS)

OPENING_MS = 1500


@dataclass(frozen=True, slots=True, kw_only=True)
class Intruder:
    """An attacker: the mode of its session, and its kind of certificate or the user of that.

    `process` is the id of zenoh under which it comes, if it claims to be a process of the robot.
    """

    mode: str
    certificate: str
    process: str = ""

    @property
    def user(self) -> str:
        """The name that it goes by."""
        return self.certificate if self.certificate in USERS else "stranger"


@dataclass(frozen=False, slots=True, kw_only=True)
class Attack:
    """A session that is open. Mutable: the keys of what it heard, by what it declared."""

    intruder: Intruder
    session: zenoh.Session
    heard: list[tuple[str, str]]

    def put(self, kind: str) -> Any:
        """A handler that notes what comes."""
        return zenoh.handlers.Callback(
            lambda sample: self.heard.append((kind, str(sample.key_expr))), indirect=False
        )

    def answer(self, query: zenoh.Query) -> None:
        """Answer a query of somebody else."""
        self.heard.append(("query", str(query.key_expr)))
        with query:
            query.reply(query.key_expr, MARK)


def credentials(lab: Lab, folder: Path, certificate: str) -> Credentials | None:
    """Return the credentials of an attacker; None if it shows no certificate."""
    ours = lab.authority.path
    match certificate:
        case "none":
            return None
        case "self-signed" | "other authority":
            folder = folder / certificate
            folder.mkdir(exist_ok=True)
            made = Authority(folder).user("ada")
            if certificate == "self-signed":
                made = _self_signed(folder)
            return Credentials(user="ada", certificate=made.certificate, key=made.key, authority=ours)
        case "expired":
            return lab.authority.user("ada", expired=True)
        case _:
            return lab.authority.user(certificate)


def _self_signed(folder: Path) -> Credentials:
    """A certificate that no authority signed but itself."""
    from datetime import UTC, datetime, timedelta

    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "ada")])
    now = datetime.now(UTC)
    builder = x509.CertificateBuilder().subject_name(name).issuer_name(name).public_key(key.public_key())
    builder = builder.serial_number(x509.random_serial_number())
    builder = builder.not_valid_before(now - timedelta(days=1)).not_valid_after(now + timedelta(days=1))
    encoding, plain = serialization.Encoding.PEM, serialization.NoEncryption()
    certificate, key_path = folder / "self.pem", folder / "self.key"
    certificate.write_bytes(builder.sign(key, hashes.SHA256()).public_bytes(encoding))
    key_path.write_bytes(key.private_bytes(encoding, serialization.PrivateFormat.PKCS8, plain))
    return Credentials(user="ada", certificate=certificate, key=key_path, authority=certificate)


def settings(intruder: Intruder, lab: Lab, folder: Path) -> dict[str, object]:
    """Return settings that invite others to connect: it listens on TCP and a unix socket, and gossips."""
    found: dict[str, object] = {
        "mode": intruder.mode,
        "connect/endpoints": [lab.endpoint],
        "connect/timeout_ms": OPENING_MS if intruder.mode == "client" else -1,
        "connect/exit_on_failure": intruder.mode == "client",
        "connect/retry": {"period_init_ms": 400, "period_max_ms": 400, "period_increase_factor": 1},
        "scouting/multicast/enabled": False,  # attackers of several tests at once would find each other
        "scouting/gossip/enabled": True,
        "scouting/gossip/multihop": True,
        "scouting/gossip/autoconnect": ["router", "peer", "client"],
        "timestamping/enabled": True,
        "transport/link/tls/root_ca_certificate": str(lab.authority.path),
    }
    if intruder.process:
        found["id"] = intruder.process
    if intruder.mode != "client":
        here = f"unixsock-stream/{folder}/{intruder.mode}"
        found["listen/endpoints"] = [f"tcp/127.0.0.1:{free_port()}", here]
    shown = credentials(lab, folder, intruder.certificate)
    if shown is not None:
        found["transport/link/tls/enable_mtls"] = True
        found["transport/link/tls/connect_certificate"] = str(shown.certificate)
        found["transport/link/tls/connect_private_key"] = str(shown.key)
    return found


def scouted(seconds: float) -> set[str]:
    """Return the ids of zenoh that answer a scouting message on loopback."""
    made = zenoh.Config()
    made.insert_json5("scouting/multicast/interface", '"lo"')
    found: set[str] = set()

    def heard(hello: zenoh.Hello) -> None:
        found.add(str(hello.zid))

    with zenoh.scout(heard, "router|peer|client", made):  # type: ignore[arg-type]  # its stub lacks functions
        time.sleep(seconds)
    return found


@contextmanager
def attacks(intruder: Intruder, lab: Lab, folder: Path) -> Iterator[Attack | None]:
    """Open the attacker's session until the end of the block; None if the gateway does not let it in."""
    made = zenoh.Config()
    for key, value in settings(intruder, lab, folder).items():
        made.insert_json5(key, json.dumps(value))
    try:
        session = zenoh.open(made)
    except zenoh.ZError:
        yield None
        return
    with session:
        yield Attack(intruder=intruder, session=session, heard=[])
