"""A client on another machine loses its lock within a second of the moment in which its cable is pulled."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from colony.runtime.frames.clock import Clock
from colony.runtime.servers.rserver import RServer
from colony.runtime.transport.live.gateway import open_gateway
from colony.runtime.transport.live.network import local_time
from colony.runtime.transport.live.security import read_security
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.runtime.transport.live.stage import hosted, place, run_directory, running, until
from tests.runtime.transport.live.test_machines import HERE, _Base, _cable, _can_make_networks, _run

TRIES = 3
SECOND = 1_000_000_000

CLIENT = """
import sys, time
from pathlib import Path
from colony.runtime.kit.connection import connect
from colony.runtime.kit.errors import ConnectionProblem
from colony.runtime.library import robot
from colony.runtime.transport.live.security import read_credentials

endpoint, login = sys.argv[1], Path(sys.argv[2])
arguments = dict(robot="rome", gateway=endpoint, credentials=read_credentials(login), timeout_s=1.0)
with connect("RServer", name="remote", priority=5, **arguments) as base:
    while True:
        try:
            base.do(robot.lock())
        except ConnectionProblem:
            pass
        time.sleep(0.1)
"""


@pytest.mark.skipif(not _can_make_networks(), reason="needs root, and to make network namespaces")
def test_a_lock_is_free_within_a_second_of_the_pulled_cable(tmp_path: Path) -> None:
    authority = Authority(tmp_path)
    security = read_security(authority.table({"ada": ("read", "command")}, HERE))
    authority.user("ada")
    login = tmp_path / "login.toml"
    login.write_text('user="ada"\ncertificate="ada.pem"\nkey="ada.key"\nauthority="authority.pem"\n')
    with ExitStack() as holds:
        environment = holds.enter_context(run_directory())
        namespace, cable = holds.enter_context(_cable())
        server = RServer(_Base(local_time(place(environment))))
        holds.enter_context(hosted(environment, [Clock(servers=("RServer",), keep=100)]))
        holds.enter_context(hosted(environment, [server]))
        endpoint = f"tls/{HERE}:{free_port()}"
        holds.enter_context(running(open_gateway(place(environment), endpoint, security)))
        command = ["ip", "netns", "exec", namespace, sys.executable, "-c", CLIENT, endpoint, str(login)]
        remote = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])})
        holds.callback(remote.wait)
        holds.callback(remote.kill)
        lock, took = server._pilot.lock, list[int]()
        while not took or (min(took) > SECOND and len(took) < TRIES):
            until(lambda: lock.holder is not None, "the client has the lock, or has it again")
            _run("ip", "link", "set", cable, "down")
            pulled = time.monotonic_ns()
            until(lambda: lock.holder is None, "the lock is free")
            took.append(time.monotonic_ns() - pulled)
            _run("ip", "link", "set", cable, "up")
        print(f"free after {', '.join(f'{ns / 1e6:.0f}' for ns in took)} ms")
        assert min(took) <= SECOND
        until(lambda: lock.holder is not None, "the client is back")
