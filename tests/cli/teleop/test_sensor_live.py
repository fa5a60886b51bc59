"""The robot of docs/teleop.md: a real gamepad is a sensor of a behavior, on a base that is simulated."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.runtime.kit.listener import hosting_listener
from colony.runtime.transport.live.robot_address import local
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, Machine, failed
from tests.cli.teleop.test_teleop_live import Verdicts
from tests.kit.gamepad import pad
from tests.pages import files
from tests.waiting import until


@pytest.mark.long
def test_a_module_drives_while_the_deadman_is_held(machine: Machine, colony: Colony, tmp_path: Path) -> None:
    verdicts = Verdicts()

    def driver() -> tuple[str | None, float] | None:
        failed(served, run)
        last = verdicts.got[-1] if verdicts.got else None
        return None if last is None or last.values is None else (last.by, round(last.values[0]))

    with pad(tmp_path) as made:
        for name, text in files("teleop.md").items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            device = f'driver = "colony.drivers.gamepad:gamepad", device = "{made.path}"'
            (tmp_path / name).write_text(text.replace('driver = "colony.drivers.gamepad:gamepad"', device))
        robot = f"buggy={tmp_path / 'robots' / 'buggy'}"
        served = machine.start("serve", "all", "--robot", robot, "--hardware", "--map", MAP)
        until(lambda: failed(served) or "Stick" in colony("ps").out, "the servers run")
        run = machine.start("drive", str(tmp_path / "hand.colony"), "--robot", robot)
        with hosting_listener(local("buggy", machine.environment), verdicts):
            until(lambda: driver() == ("circle", 100), "nobody holds it")
            made.move(y=-1.0)
            made.press("tl")
            until(lambda: driver() == ("operator", 300), "the operator drives")
            made.release("tl")
            until(lambda: driver() == ("circle", 100), "the program drives")
            made.press("tl")
            until(lambda: driver() == ("operator", 300), "the operator drives")
            made.unplug()
            until(lambda: driver() == ("circle", 100), "the gamepad is gone")
            until(lambda: "FAILS: the gamepad is gone: No such device" in colony("ps").out, "it is said")
            made.plug()
            made.press("tl")
            until(lambda: driver() == ("operator", 0), "it is back")
        assert run.interrupt() in (0, 130)
