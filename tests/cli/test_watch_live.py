"""`colony watch` of a robot that runs, by users of a gateway: what they see, and what they may stop."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.cli.machine import MAP, ROBOT, WANDER, Machine, Started
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.waiting import until
from tests.watch.runs import Page, page

pytestmark = pytest.mark.long


@pytest.fixture
def driving(tmp_path: Path) -> Iterator[Machine]:
    machine = Machine(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    run = machine.start("run", WANDER, "--map", MAP, "--processes", "--no-picture", "--duration", "1000")
    until(lambda: run.ended() or machine.moves(), "the robot drives")
    assert not run.ended(), run.err
    yield machine
    machine.close()


def credentials(authority: Authority, name: str, folder: Path) -> Path:
    """Write the file of a user's credentials."""
    made = authority.user(name)
    path = folder / f"{name}.toml"
    lines = {"user": name, "certificate": made.certificate, "key": made.key, "authority": made.authority}
    path.write_text("".join(f'{key} = "{value}"\n' for key, value in lines.items()))
    return path


@contextmanager
def opened(watcher: Started) -> Iterator[Page]:
    until(lambda: watcher.ended() or "http" in watcher.out, "the page is served")
    assert not watcher.ended(), watcher.err
    host, token = watcher.out.split()[-1].removeprefix("http://").split("/#")
    with page(host, token=token) as shown:
        yield shown


def test_users_of_a_gateway_have_their_rights(driving: Machine, tmp_path: Path) -> None:
    certificates = tmp_path / "certificates"
    certificates.mkdir()
    authority, endpoint = Authority(certificates), f"tls/localhost:{free_port()}"
    table = authority.table({"bob": ("read",), "dora": ("read", "stop")})
    gateway = driving.start(
        "serve", "Gateway", "--robot", ROBOT, "--listen", endpoint, "--security", str(table)
    )
    until(lambda: gateway.ended() or "listens at" in gateway.err, "the gateway listens")
    for name, may_stop in (("bob", False), ("dora", True)):
        file = credentials(authority, name, certificates)
        options = ("--connect", endpoint, "--security", str(file), "--allow-stop", "--port", "0")
        with opened(driving.start("watch", "--robot", ROBOT, *options)) as shown:
            found = shown.until(lambda m: m.get("snapshot", {}).get("is_known"))["snapshot"]
            assert found["commands"][0]["is_decided"]
            shown.ask(do="ask", module="cruise", k=found["k"])
            assert shown.until(lambda m: "answer" in m)["answer"]["lines"]
            shown.ask(do="stop")
            assert shown.until(lambda m: "stop" in m)["stop"]["is_kept"] is may_stop
            if may_stop:
                until(driving.stands, "the robot stands")
                shown.until(lambda m: m.get("snapshot", {}).get("stopped_by") is not None)
            else:
                until(driving.moves, "the robot drives on")
