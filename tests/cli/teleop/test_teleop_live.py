"""`colony teleop` as a process, beside a program, at a robot that is served."""

from __future__ import annotations

import pty
import signal
import termios
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from colony.runtime.kit.listener import hosting_listener
from colony.runtime.library.clock import participants
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Effect, Message, QuietNode, Verdict
from colony.runtime.transport.live.robot_address import local
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, ROBOT, Machine, Started, audited, failed, release
from tests.cli.test_watch_live import credentials
from tests.kit.gamepad import pad
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.waiting import until

FRAME_S = 0.05


class Verdicts(QuietNode):
    """A node that keeps verdicts. Mutable: those of the base so far."""

    address = "verdicts"
    listens = (topics.VERDICTS,)

    def __init__(self) -> None:
        self.got: list[Verdict] = []

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, Verdict) and message.actuator == "drive":
            self.got.append(message)
        return ()


class Ride:
    """A served robot that wanders, and what is decided about it."""

    def __init__(self, machine: Machine, verdicts: Verdicts, run: Started) -> None:
        self.machine, self.verdicts, self.run = machine, verdicts, run

    def since(self, k: int) -> list[Verdict]:
        return [verdict for verdict in self.verdicts.got if verdict.k >= k]

    def newest(self) -> int:
        """Return the number of the newest frame."""
        with self.machine.session() as session, session.connect("Clock") as clock:
            return clock.do(participants()).k

    def driven_by_operator(self, teleop: Started, since: int = 0) -> list[Verdict]:
        """Wait until the operator commands, for three frames in a row."""

        def found() -> list[Verdict]:
            failed(teleop, self.run)
            last = self.since(since)[-3:]
            return last if len(last) == 3 and all(verdict.outside for verdict in last) else []

        return until(found, "the operator drives")

    def driven_by_network(self, since: int) -> list[Verdict]:
        """Wait until the network commands again; return all verdicts from that frame on."""

        def found() -> list[Verdict]:
            failed(self.run)
            verdicts = self.since(since)
            return verdicts if verdicts and verdicts[-1].by is not None else []

        return until(found, "the network drives")


@contextmanager
def ride(machine: Machine) -> Iterator[Ride]:
    verdicts = Verdicts()
    served = machine.start("serve", "all", "--robot", ROBOT, "--map", MAP)
    until(lambda: failed(served) or machine.truth() is not None, "the simulator runs")
    run = machine.start("drive", "wander", "--robot", ROBOT, "--record", "run.mcap")
    with hosting_listener(local(ROBOT, machine.environment), verdicts):
        until(lambda: failed(served, run) or (verdicts.got and machine.moves()), "it wanders")
        yield Ride(machine, verdicts, run)


@pytest.mark.long
def test_a_gamepad_takes_over_within_the_limits_and_gives_way(machine: Machine, tmp_path: Path) -> None:
    with ride(machine) as on, pad(tmp_path) as made:
        teleop = machine.start("teleop", "--gamepad", str(made.path), "--speed", "0.6m/s")
        until(lambda: failed(teleop) or "drives" in teleop.out, "it says who drives")
        made.move(y=-1.0, rx=-0.4)  # into the wall of the corridor, in an arc
        made.press("tl")
        last = on.driven_by_operator(teleop)[-1]
        until(lambda: "you drive" in teleop.out, "it says that you drive")
        until(lambda: failed(teleop) or "you drive, limited" in teleop.out, "limits hold it at a wall")
        made.release("tl")
        verdicts = on.driven_by_network(last.k)
        commanded = [verdict for verdict in verdicts if verdict.outside is not None]
        assert commanded == verdicts[: len(commanded)], "it gives way once, and for good"
        assert not any(verdict.unlimited for verdict in commanded)

        made.press("tl")
        on.driven_by_operator(teleop, on.newest())
        teleop.tell(signal.SIGKILL)
        teleop.process.wait()
        killed = on.newest()
        verdicts = on.driven_by_network(killed)
        assert sum(v.outside is not None for v in verdicts) <= 0.3 / FRAME_S + 1, "the lease has ended"

        below = machine.start("teleop", "--gamepad", str(made.path), "--priority", "0")
        until(lambda: failed(below) or "drives" in below.out, "it says who drives")
        made.release("tl")
        made.press("tl")
        until(lambda: failed(below) or "drives, above your priority 0" in below.out, "it is not let")
        assert not any(verdict.outside for verdict in on.since(killed + 8))
        assert below.interrupt() == 0
        assert on.run.interrupt() == 130
        assert audited(machine, on.run)


@pytest.mark.long
def test_the_emergency_stop_of_a_gamepad_and_its_end(
    machine: Machine, colony: Colony, tmp_path: Path
) -> None:
    with ride(machine) as on, pad(tmp_path) as made:
        teleop = machine.start("teleop", "--gamepad", str(made.path))
        until(lambda: failed(teleop) or "drives" in teleop.out, "it says who drives")
        made.press("tl")
        last = on.driven_by_operator(teleop)[-1]
        made.press("east")
        until(lambda: failed(teleop) or "EMERGENCY STOP, by" in teleop.out, "the robot is stopped")
        until(machine.stands, "it stands")
        assert f"{ROBOT}: stopped by" in teleop.out
        assert "EMERGENCY STOP" in colony("ps").out
        with machine.session() as session:
            release(session)
        assert not any(verdict.outside for verdict in on.driven_by_network(last.k)[-1:])
        made.unplug()
        until(lambda: failed(teleop) or "the gamepad is gone" in teleop.out, "it is gone")
        teleop.tell(signal.SIGTERM)
        assert teleop.wait() == 0


@pytest.mark.long
def test_the_keys_of_a_terminal_drive(machine: Machine) -> None:
    typed, terminal = pty.openpty()
    before = termios.tcgetattr(terminal)
    with ride(machine) as on, open(typed, "wb", buffering=0) as keys, open(terminal, "rb"):
        for end in (signal.SIGTERM, "q"):
            teleop = machine.start("teleop", stdin=terminal)
            until(lambda: failed(teleop) or "drives" in teleop.out, "it says who drives")  # noqa: B023
            assert not termios.tcgetattr(terminal)[3] & termios.ECHO
            k = on.newest()

            def backs() -> bool:
                keys.write(b"s")
                return any(verdict.values == (-300.0, 0.0) for verdict in on.since(k))  # noqa: B023

            until(backs, "it drives back")
            keys.write(b" ")
            on.driven_by_network(on.newest())
            if isinstance(end, signal.Signals):
                teleop.tell(end)
            else:
                keys.write(end.encode())
            assert teleop.wait() == 0
            assert termios.tcgetattr(terminal) == before


@pytest.mark.long
def test_users_of_a_gateway_drive_by_their_rights_while_the_network_holds(
    machine: Machine, tmp_path: Path
) -> None:
    (folder := tmp_path / "certificates").mkdir()
    authority, endpoint = Authority(folder), f"tls/localhost:{free_port()}"
    table = authority.table({"ada": ("command",), "bob": ("read",)})
    with ride(machine) as on, pad(tmp_path) as made:
        gateway = machine.serve("Gateway", "--robot", ROBOT, "--listen", endpoint, "--security", str(table))

        def teleop(user: str) -> Started:
            login = ("--connect", endpoint, "--security", str(credentials(authority, user, folder)))
            return machine.start("teleop", "--robot", ROBOT, "--gamepad", str(made.path), *login)

        made.move(y=-1.0)
        made.press("tl")
        bob = teleop("bob")
        assert bob.wait() == 1
        assert "RServer.drive needs the right to command, and bob may only read" in bob.err
        made.press("tl")
        ada = teleop("ada")
        on.driven_by_operator(ada, on.newest())
        gateway.tell(signal.SIGSTOP)
        on.driven_by_network(on.newest())
        gateway.tell(signal.SIGCONT)
        on.driven_by_operator(ada, on.newest())
        assert ada.interrupt() == 0
