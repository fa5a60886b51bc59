"""`colony shadow` reads a robot and commands nothing, whatever it would do and becomes of it."""

from __future__ import annotations

import json
import signal
from contextlib import closing
from pathlib import Path

import pytest

from colony.drivers.create2.codec import OiMode
from colony.drivers.create2.firmware import Create2Firmware, EmulatedWorld
from colony.drivers.emulator import Emulator, room
from colony.runtime.kit.connection import Session
from tests.cli.conftest import Colony, server_states
from tests.cli.machine import MAP, WANDER, Machine, Started, failed, status
from tests.paths import ROOT
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.waiting import until

BOUNCE, TELEOP = (str(ROOT / "behaviors" / f"{name}.colony") for name in ("bounce", "teleop"))


def lines(shadow: Started) -> int:
    """Return the number of decisions that a shadow has shown."""
    return shadow.err.count("would send drive(")


def audited(colony: Colony, recording: Path) -> dict[str, object]:
    result = colony("audit", recording, "--format", "json")
    assert result.code == 0, result.out + result.err
    found: dict[str, object] = json.loads(result.out)
    return found


@pytest.mark.long
def test_a_create_never_moves(machine: Machine, colony: Colony) -> None:
    robot = Create2Firmware(EmulatedWorld(range=room(6000.0, 6000.0)))
    with closing(Emulator(robot, baud=115_200)) as emulator:
        emulator.start()
        served = machine.start("serve", "all", "--robot", "create2", "--port", emulator.port)
        until(lambda: robot.mode == OiMode.SAFE or failed(served), "the robot is ready")
        shadow = machine.start("shadow", BOUNCE, "--robot", "create2", "--record", "shadow.mcap")
        until(lambda: "by cruise" in shadow.err or failed(served, shadow), "it would drive")
        shown = lines(shadow)
        until(lambda: lines(shadow) >= shown + 3 or failed(served, shadow), "it would go on")
        assert robot.pose == (0.0, 0.0, 0.0)
        assert robot.wheels == (0.0, 0.0)
        assert shadow.interrupt() == 130
        assert "SHADOW: this is what it would have sent; it commanded nothing" in shadow.out
        assert audited(colony, shadow.folder / "shadow.mcap")["shadow"] is True
        assert robot.pose == (0.0, 0.0, 0.0)
        assert served.interrupt() == 0


@pytest.mark.long
def test_whoever_drives_never_notices(machine: Machine, colony: Colony) -> None:
    served = machine.start("serve", "all", "--robot", "rome", "--map", MAP)
    until(lambda: machine.pid("RServer") or failed(served), "the robot runs")
    run = machine.start("drive", WANDER, "--record", "run.mcap")
    until(lambda: machine.moves() or failed(served, run), "wander drives")
    shadow = machine.start("shadow", TELEOP, "--robot", "rome", "--record", "shadow.jsonl")
    until(lambda: lines(shadow) or failed(served, run, shadow), "teleop would decide")
    with machine.session() as session:
        shadow.tell(signal.SIGSTOP)
        goes_on(machine, session, "wander drives beside a frozen shadow", served, run)
        shadow.tell(signal.SIGKILL)
        shadow.process.wait()
        goes_on(machine, session, "wander drives after a killed shadow", served, run)
    assert "Shadow" not in server_states(colony)
    assert run.interrupt() == 130
    assert served.interrupt() == 0
    assert audited(colony, run.folder / "run.mcap")["shadow"] is False
    result = colony("audit", shadow.folder / "shadow.jsonl", TELEOP)
    assert result.code == 0, result.out + result.err
    assert "SHADOW" in result.out


@pytest.mark.long
def test_behind_a_gateway_the_right_to_read_is_enough(
    machine: Machine, colony: Colony, tmp_path: Path
) -> None:
    authority, port = Authority(tmp_path), free_port()
    table, ada = authority.table({"ada": ("read",)}), authority.user("ada")
    login = tmp_path / "login.toml"
    names = ("certificate", "key", "authority")
    login.write_text("\n".join(['user = "ada"', *(f'{name} = "{getattr(ada, name)}"' for name in names)]))
    gateway = f"tls/127.0.0.1:{port}"
    served = machine.start(
        "serve", "all", "--robot", "rome", "--map", MAP, "--listen", gateway, "--security", str(table)
    )
    until(lambda: (machine.pid("Gateway") and machine.truth()) or failed(served), "the robot runs")
    connected = ("--robot", "rome", "--connect", gateway, "--security", str(login))
    shadow = machine.start("shadow", WANDER, *connected, "--duration", "3", "--record", "s.mcap")
    assert shadow.wait() == 0, shadow.err
    assert lines(shadow)
    assert audited(colony, shadow.folder / "s.mcap")["shadow"] is True
    assert served.interrupt() == 0


def goes_on(machine: Machine, session: Session, what: str, *started: Started) -> None:
    """Wait for 100 more frames of the run, in which the robot moves."""
    before = frames(session)
    until(lambda: frames(session) > before + 100 or failed(*started), what)
    until(lambda: machine.moves() or failed(*started), what)


def frames(session: Session) -> int:
    """Return the number of frames of the run; 0 while its leader does not answer."""
    found = status(session)
    return 0 if found is None else found.frames


@pytest.mark.parametrize("option", ["--map", "--set", "--to", "--isolate", "--picture"])
def test_shadow_lacks_options_that_command(colony: Colony, option: str) -> None:
    assert f"No such option '{option}'" in colony.one_line("shadow", WANDER, option)


def test_a_robot_that_does_not_run(machine: Machine, colony: Colony) -> None:
    assert "no process of `rome` runs on this machine" in colony.refusal("shadow", WANDER)
