"""examples/two_robots: run for real, by the commands of its script, with both keepers killed on the way."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from colony.sim.plant.control import PlantControl
from colony.sim.plant.protocol import Truth
from tests.cli.machine import contracts_held
from tests.examples.stage import ROOT, Machine, Process, machine
from tests.waiting import until

HERE = ROOT / "examples" / "two_robots"
COMMANDS = [
    line.removesuffix(" &") for line in (HERE / "start.sh").read_text().splitlines() if line.endswith(" &")
]
ROBOTS = ("ada", "ben")

CORRIDOR = (5000.0, 6500.0)
RADIUS_MM = 400.0


def of(robot: str, word: str) -> str:
    """The command of the script that starts a program of a robot."""
    [command] = [c for c in COMMANDS if word in c and c.endswith(f"--robot {robot}")]
    return command


class Watch:
    """Looks where the robots really are, all the time. Mutable: what it saw."""

    def __init__(self, plant: PlantControl) -> None:
        self.now: dict[str, Truth] = {}
        self.passed: set[str] = set()
        self.together: list[dict[str, Truth]] = []
        self._control = plant
        self._begin: dict[str, float] = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look)
        self._thread.start()

    def inside(self, robot: str) -> bool:
        """Whether a part of the robot is in the corridor."""
        return CORRIDOR[0] - RADIUS_MM < self.now[robot].x < CORRIDOR[1] + RADIUS_MM

    def end(self) -> None:
        """Look no more."""
        self._over.set()
        self._thread.join()
        self._control.close()

    def _look(self) -> None:
        while not self._over.wait(0.01):
            self.now = {robot: self._control.truth(robot) for robot in ROBOTS}
            if all(self.inside(robot) for robot in ROBOTS):
                self.together.append(self.now)
            for robot in ROBOTS:
                x = self.now[robot].x
                begin = self._begin.setdefault(robot, x)
                if not self.inside(robot) and (x < CORRIDOR[0]) != (begin < CORRIDOR[0]):
                    self.passed.add(robot)


@contextmanager
def watching(on: Machine) -> Iterator[Watch]:
    """Look where the robots are, in the block."""
    watch = Watch(on.plant("ada"))
    try:
        until(lambda: bool(watch.now), "the plant tells where the robots are")
        yield watch
    finally:
        watch.end()


@pytest.mark.thorough
def test_one_at_a_time_although_both_keepers_are_killed() -> None:
    with machine() as on:
        programs = [c for c in COMMANDS if "drive " in c or "keeper" in c]
        building, *servers = [on.start(c) for c in COMMANDS if c not in programs]
        keepers = {robot: on.start(of(robot, "keeper.py")) for robot in ROBOTS}
        building.says("ada, ben")
        for process in (*servers, *keepers.values()):
            process.says("listens" if process in servers else "is there")
        with watching(on) as watch:
            runs = [on.start(of(robot, "passage.colony")) for robot in ROBOTS]
            first, second = _whose_turn(keepers)
            keepers[first].kill()  # before its robot has come to the line: the turn goes to the other one
            keepers[second].says("may enter")
            until(lambda: watch.inside(second), f"{second} is in the corridor")
            keepers[second].kill()  # its robot goes on, and nobody comes in
            keepers[first] = on.start(of(first, "keeper.py"))
            keepers[first].says("has its turn")
            until(lambda: second in watch.passed, f"{second} is through")
            assert "may enter" not in keepers[first].printed()
            keepers[second] = on.start(of(second, "keeper.py"))
            keepers[first].says("may enter")
            keepers[first].says("is out of the corridor")
            assert watch.passed == set(ROBOTS)
            assert watch.together == []
            assert [watch.now[robot].bumps for robot in ROBOTS] == [0, 0]
        for run in runs:
            run.finish()
            assert contracts_held(run.printed()), run.printed()


def _whose_turn(keepers: dict[str, Process]) -> tuple[str, str]:
    """Who has the first turn, and who has not."""

    def having() -> list[str]:
        return [robot for robot in ROBOTS if "has its turn" in keepers[robot].printed()]

    until(lambda: bool(having()), "a keeper has its turn")
    [first] = having()
    [second] = set(ROBOTS) - {first}
    return first, second


def test_the_readme_names_what_is_there() -> None:
    readme = (HERE / "README.md").read_text(encoding="utf-8")
    for name in re.findall(r"\]\(([^)#]+)\)", readme):
        assert (HERE / name).exists(), name
    assert "sh examples/two_robots/start.sh" in readme
