"""The guard of a TCP port: a connection to a simulator is a session, which begins with the handshake."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from colony.drivers import guarded
from colony.drivers.guarded import GuardedCommand, connect
from colony.drivers.serial_base import SerialActuators, SerialBase, SerialFields
from tests.drivers.test_guard import PATIENCE_S, await_refusal, await_up
from tests.drivers.tiny import HELLO, JAW, SPEEDS, Tiny, decoder, encoded


class Polite(Tiny):
    """The tiny protocol of a simulator that takes the first frame for the handshake."""

    handshake_first = True


class Simulator:
    """A listening simulator; it answers when the test says so."""

    def __init__(self) -> None:
        self._listener = socket.socket()
        self._listener.bind(("127.0.0.1", 0))
        self._listener.settimeout(PATIENCE_S)
        self.port = f"tcp:127.0.0.1:{self._listener.getsockname()[1]}"

    def listen(self) -> None:
        """Take connections from now on, which were refused before."""
        self._listener.listen()

    def accept(self) -> socket.socket:
        connection, _ = self._listener.accept()
        connection.settimeout(PATIENCE_S)
        return connection

    def close(self) -> None:
        self._listener.close()


@pytest.fixture
def simulator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Simulator]:
    monkeypatch.setenv("COLONY_RUN_DIR", str(tmp_path))
    simulator = Simulator()
    yield simulator
    simulator.close()
    for process in guarded._guards:
        process.terminate()
        process.wait(PATIENCE_S)
    guarded._guards.clear()


def kinds(connection: socket.socket, count: int) -> list[int]:
    """Return the kinds of the next frames."""
    found: list[int] = []
    frames = decoder()
    while len(found) < count:
        found += [data[0] for data in frames.feed(connection.recv(1))]
    return found


def test_a_new_connection_begins_with_the_handshake(simulator: Simulator) -> None:
    simulator.listen()
    with closing(SerialBase(Polite(), simulator.port)) as driver:
        for _ in range(2):  # the second one is opened again
            with simulator.accept() as connection:
                assert kinds(connection, 2) == [HELLO, HELLO]
        with simulator.accept() as connection:
            assert kinds(connection, 1) == [HELLO]
            connection.sendall(encoded(bytes([4])))
            driver.close()
            while kinds(connection, 1) != [SPEEDS]:  # the stop, as the driver has ended
                pass


def test_a_guard_that_a_listener_starts_leaves_the_beginning_to_the_driver(simulator: Simulator) -> None:
    simulator.listen()
    with (
        closing(SerialFields(Polite(), simulator.port, {"level": "volts"})),
        simulator.accept() as connection,
        closing(SerialBase(Polite(), simulator.port)),
    ):
        assert kinds(connection, 1) == [HELLO]


def test_what_was_sent_before_a_line_was_open_does_not_begin_it(simulator: Simulator) -> None:
    command = GuardedCommand(stop=Tiny.stop_bytes, goodbye=b"", deadline_ns=150_000_000, handshake_first=True)
    with closing(connect(simulator.port, 0, b"", command)) as driver:
        driver.send(Tiny.goodbye)
        with closing(connect(simulator.port, 0, b"", command)) as second:
            await_refusal(second)  # the guard has read the goodbye then
        simulator.listen()
        await_up(driver)
        driver.send(encoded(bytes([HELLO])))
        with simulator.accept() as connection:
            assert kinds(connection, 1) == [HELLO]


def test_an_actuator_that_is_added_during_the_handshake_does_not_disturb_it(simulator: Simulator) -> None:
    simulator.listen()
    drivers: list[SerialBase[bytes] | SerialActuators[bytes]] = [SerialBase(Polite(), simulator.port)]
    try:
        with simulator.accept() as connection:
            assert kinds(connection, 1) == [HELLO]
            drivers.append(SerialActuators(Polite(), simulator.port, {}, {"jaw": Polite.jaw_stop}))
            assert drivers[0]._line is drivers[1]._line
            assert kinds(connection, 1) == [HELLO]
            connection.sendall(encoded(bytes([4])))
            while (kind := kinds(connection, 1)) != [JAW]:
                assert kind == [HELLO]
    finally:
        for driver in drivers:
            driver.close()


def test_any_other_device_hears_the_stop_first(simulator: Simulator) -> None:
    simulator.listen()
    with closing(SerialBase(Tiny(), simulator.port)), simulator.accept() as connection:
        assert kinds(connection, 1) == [SPEEDS]
