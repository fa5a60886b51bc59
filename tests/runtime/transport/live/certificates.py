"""Certificates for tests: an authority, a gateway for `localhost`, users."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

import trustme

from colony.runtime.transport.live.robot_address import Credentials
from colony.runtime.transport.live.security import Permission

EXPIRED = datetime(2020, 1, 1, tzinfo=UTC)


class Authority:
    """Signs certificates and puts them into a folder."""

    def __init__(self, folder: Path, name: str = "authority") -> None:
        self._folder = folder
        self._signer = trustme.CA()
        self.path = folder / f"{name}.pem"
        self._signer.cert_pem.write_to_path(self.path)

    def user(self, name: str, *, called: str | None = None, expired: bool = False) -> Credentials:
        """Credentials of a user; `called` is what they say that the name is, if it is not so."""
        file = f"{name}-expired" if expired else name
        path = self._issue(file, name, not_after=EXPIRED if expired else None)
        return Credentials(
            user=called or name, certificate=path, key=path.with_suffix(".key"), authority=self.path
        )

    def table(self, users: Mapping[str, tuple[Permission, ...]], *hosts: str) -> Path:
        """A table of users, with a certificate for a gateway at `hosts`."""
        self._issue("gateway", "gateway", *(hosts or ("localhost", "127.0.0.1")))
        lines = ["[gateway]", 'certificate = "gateway.pem"', 'key = "gateway.key"']
        lines.append(f'authority = "{self.path.name}"')
        for name, may in users.items():
            lines += [f'[users."{name}"]', f"may = [{', '.join(repr(p) for p in may)}]"]
        path = self._folder / "users.toml"
        path.write_text("\n".join(lines))
        return path

    def _issue(self, file: str, name: str, *hosts: str, not_after: datetime | None = None) -> Path:
        made = self._signer.issue_cert(*(hosts or (name,)), common_name=name, not_after=not_after)
        path = self._folder / f"{file}.pem"
        path.write_bytes(b"".join(part.bytes() for part in made.cert_chain_pems))
        key = path.with_suffix(".key")
        key.touch(0o600)
        made.private_key_pem.write_to_path(key)
        return path


def free_port() -> int:
    """A port that nobody listens at."""
    with socket.socket() as asking:
        asking.bind(("127.0.0.1", 0))
        port: int = asking.getsockname()[1]
        return port
