"""Who gets through a gateway, and what those are told who do not."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
import zenoh

from colony.runtime.kit.connection import Session, connect
from colony.runtime.transport.live import configuration
from colony.runtime.transport.live.gateway import open_gateway
from colony.runtime.transport.live.robot_address import Credentials
from colony.runtime.transport.live.run_directory import SecurityError, UnreachableError
from colony.runtime.transport.live.security import read_security
from tests.runtime.kit.stage import BATTERY
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.runtime.transport.live.gateway_lab import USERS, Lab, gateway_for
from tests.runtime.transport.live.stage import ROBOT, robot_address, run_directory


def test_logins_that_are_refused(lab: Lab, tmp_path: Path) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    stranger = Authority(folder, "stranger")
    ada, eve = lab.authority.user("ada"), stranger.user("ada")
    forged = Credentials(user="ada", certificate=eve.certificate, key=eve.key, authority=ada.authority)
    fooled = Credentials(user="ada", certificate=ada.certificate, key=ada.key, authority=stranger.path)
    port = lab.endpoint.rsplit(":", 1)[1]
    cases = (
        (forged, lab.endpoint, r"refuses .*ada.pem: .*UNKNOWN_CA"),
        (fooled, lab.endpoint, r"is not to be trusted: .*stranger.pem"),
        (lab.authority.user("ada", expired=True), lab.endpoint, r"refuses .*ada-expired.pem: .*EXPIRED"),
        (lab.authority.user("zoe"), lab.endpoint, r"does not admit zoe: .*table of users for rome"),
        (lab.authority.user("bob", called="ada"), lab.endpoint, r"does not admit ada: .*bob.pem"),
        (
            lab.authority.user("ada"),
            f"tls/127.0.0.2:{port}",
            r"not to be trusted: .*for `127.0.0.2`|Connection refused",
        ),
        (
            lab.authority.user("ada"),
            f"tls/localhost:{free_port()}",
            r"no process listens .*Connection refused",
        ),
    )
    for (credentials, endpoint, says), problem in zip(cases, _all_refused(cases), strict=True):
        assert isinstance(problem, UnreachableError), (credentials, endpoint, problem)
        assert _matches(says, str(problem)), problem


def _all_refused(cases: tuple[tuple[Credentials, str, str], ...]) -> list[BaseException | None]:
    """Try all at once: each waits for as long as a gateway may take."""
    found: list[BaseException | None] = [None] * len(cases)

    def attempt(index: int, credentials: Credentials, endpoint: str) -> None:
        try:
            Session.open(ROBOT, gateway=endpoint, credentials=credentials).close()
        except Exception as problem:
            found[index] = problem

    threads = [threading.Thread(target=attempt, args=(n, c, e)) for n, (c, e, _) in enumerate(cases)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    return found


def _matches(pattern: str, text: str) -> bool:
    import re

    return re.search(pattern, text, re.DOTALL | re.IGNORECASE) is not None


def test_nothing_goes_in_the_clear(lab: Lab) -> None:
    in_the_clear = lab.endpoint.replace("tls/", "tcp/")
    with pytest.raises(SecurityError, match="is unencrypted"):
        connect(BATTERY, robot=ROBOT, gateway=in_the_clear, credentials=lab.authority.user("ada"))
    security = read_security(lab.authority.table(USERS))
    with pytest.raises(SecurityError, match="is unencrypted"):
        open_gateway(robot_address(lab.environment), in_the_clear, security)
    settings = {"mode": "client", "connect/endpoints": [in_the_clear], "connect/timeout_ms": 300}
    with pytest.raises(zenoh.ZError):
        zenoh.open(configuration.configuration({**settings, "scouting/multicast/enabled": False}))


def test_a_certificate_is_wanted(lab: Lab) -> None:
    with pytest.raises(ValueError, match="no credentials for the gateway"):
        Session.open(ROBOT, gateway=lab.endpoint)
    ada = lab.remote("ada")
    settings = {
        key: value
        for key, value in configuration.settings(ada).items()
        if key not in ("transport/link/tls/connect_certificate", "transport/link/tls/connect_private_key")
    }
    settings |= {"transport/link/tls/enable_mtls": False, "connect/timeout_ms": 300}
    with pytest.raises(zenoh.ZError):
        zenoh.open(configuration.configuration(settings))


def test_two_gateways_to_one_robot_and_a_port_that_is_taken(lab: Lab, tmp_path: Path) -> None:
    security = read_security(lab.authority.table(USERS))
    with pytest.raises(Exception, match="Gateway of rome is already running"):
        open_gateway(robot_address(lab.environment), f"tls/localhost:{free_port()}", security)
    with run_directory() as other, pytest.raises(UnreachableError, match=r"cannot listen at .*tls/localhost"):
        open_gateway(robot_address(other), lab.endpoint, security)


def test_a_user_who_was_taken_out_of_the_table_is_out(lab: Lab, tmp_path: Path) -> None:
    with run_directory() as environment:
        other = Lab(environment, lab.authority, f"tls/localhost:{free_port()}")
        with gateway_for(other, USERS), other.session("bob") as session:
            assert session.servers() == ("Gateway",)
        with (
            gateway_for(other, {"ada": ("read",)}),
            pytest.raises(UnreachableError, match="does not admit bob"),
        ):
            other.session("bob")
