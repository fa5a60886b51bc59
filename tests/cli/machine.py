"""A machine of its own for tests: a run directory in a temporary folder, and `colony` as processes there.

Everything that was started is ended by its own id, also where a test fails in the middle.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library import clock as clock_library
from colony.runtime.library.leader import LEADER, RunStatus, run_status
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.run_directory import RobotDirectory, RunDirectory
from colony.sim.plant.child import plant_socket
from colony.sim.plant.control import PlantControl
from colony.sim.plant.protocol import Truth
from tests.paths import ROOT
from tests.waiting import PATIENCE_S, until

MAP = str(ROOT / "maps" / "loop.stickrep")
WANDER = str(ROOT / "behaviors" / "wander.colony")
ROBOT = "rome"


def contracts_held(printed: str) -> bool:
    """Return True if a run tells of no broken contract, and of each that it held wherever memory was known.

    On a busy machine the leader may miss a frame; what rests on memory cannot be judged for a while then.
    """
    unknown = re.search(r"frames? not checked: memory was unknown", printed)
    told = unknown or re.search(r"contracts? held in every frame", printed)
    return told is not None and "BROKEN" not in printed


def lives(pid: int) -> bool:
    """Whether there is such a process, and it is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in ("Z", "X")
    except (FileNotFoundError, ProcessLookupError):
        return False


def children_of(pid: int) -> set[int]:
    """The processes that a process has started and that are there still."""
    found = set()
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        found |= {int(child) for child in task.read_text().split()}
    return found


class Started:
    """A `colony` command as a process. Mutable: whether it has ended."""

    def __init__(
        self,
        arguments: tuple[str, ...],
        environment: Mapping[str, str],
        folder: Path,
        enter: tuple[str, ...] = (),
        stdin: int = subprocess.DEVNULL,
    ) -> None:
        self._out, self._err = folder / "out", folder / "err"
        folder.mkdir()
        with self._out.open("wb") as out, self._err.open("wb") as err:
            self.process = subprocess.Popen(
                [*enter, sys.executable, "-m", "colony.cli.main", *arguments],
                stdin=stdin,
                stdout=out,
                stderr=err,
                env=environment,
                cwd=folder,
                process_group=0,
            )
        self.pid = self.process.pid
        self.folder = folder

    @property
    def out(self) -> str:
        return self._out.read_text()

    @property
    def err(self) -> str:
        return self._err.read_text()

    def tell(self, number: int) -> None:
        """Send it a signal."""
        self.process.send_signal(number)

    def wait(self, patience_s: float = PATIENCE_S) -> int:
        """Its exit code."""
        code = self.process.wait(patience_s)
        assert "Traceback" not in self.err, self.err
        return code

    def interrupt(self) -> int:
        """End it as Ctrl-C does; gives its exit code."""
        self.tell(signal.SIGINT)
        return self.wait()

    def ended(self) -> bool:
        return self.process.poll() is not None


class Machine:
    """Mutable: what runs on it.

    Args:
        folder: for its files.
        enter: what its commands begin with, as those do that have a small disk.
        variables: of its environment, besides the usual ones.
    """

    def __init__(self, folder: Path, enter: tuple[str, ...] = (), **variables: str) -> None:
        self._folder = folder
        self._enter = enter
        self.environment = {
            **os.environ,
            "COLONY_RUN_DIR": str(folder / "r"),
            "XDG_STATE_HOME": str(folder / "s"),
            "PYTHONPATH": str(ROOT),
            **variables,
        }
        self._started: list[Started] = []

    def start(self, *arguments: str, enter: tuple[str, ...] = (), stdin: int = subprocess.DEVNULL) -> Started:
        """Run `colony ARGUMENTS`, by a command that begins with `enter` if need be."""
        folder = self._folder / f"{len(self._started)}"
        started = Started(arguments, self.environment, folder, enter or self._enter, stdin)
        self._started.append(started)
        return started

    def run(self, *arguments: str, patience_s: float = PATIENCE_S) -> Started:
        """The same, to its end."""
        started = self.start(*arguments)
        started.wait(patience_s)
        return started

    def serve(self, *arguments: str) -> Started:
        """Run `colony serve ARGUMENTS`, and wait until the server listens."""
        started = self.start("serve", *arguments)
        until(lambda: failed(started) or "listens at" in started.err, f"{arguments[0]} listens")
        return started

    def close(self) -> None:
        """End what is left, and see to it that nothing stays behind."""
        for started in self._started:
            if not started.ended():
                left = children_of(started.pid)
                started.process.terminate()
                try:
                    started.process.wait(PATIENCE_S)
                finally:
                    started.process.kill()
                    for pid in filter(lives, left):
                        os.kill(pid, signal.SIGKILL)

    @property
    def directory(self) -> RobotDirectory:
        return RunDirectory.find(self.environment).robot(ROBOT)

    def pid(self, server: str) -> int | None:
        """Of the process that serves a name."""
        return self.directory.running().get(server)

    def truth(self) -> Truth | None:
        """What is true of the simulated robot, None while the plant does not answer."""
        try:
            with PlantControl(plant_socket(self.directory.path)) as control:
                return control.truth(ROBOT)
        except OSError:
            return None

    def moves(self) -> bool:
        """Whether the robot really moves."""
        truth = self.truth()
        return truth is not None and abs(truth.velocity) > 1.0

    def stands(self) -> bool:
        """Whether it really stands."""
        truth = self.truth()
        return truth is not None and truth.velocity == 0.0 and truth.turn == 0.0

    def session(self) -> Session:
        """A session with the robot, as an outside program has one."""
        return Session.open(ROBOT, environment=self.environment)


def failed(*started: Started) -> bool:
    """False while none of them has ended.

    Raises:
        AssertionError: one has; the message is what it said.
    """
    for one in started:
        assert not one.ended(), one.err
    return False


def audited(machine: Machine, run: Started) -> bool:
    """Whether what a run recorded into `run.mcap` is what the interpreter decides, wherever memory was known.

    Raises:
        AssertionError: it is not; the message is what was said.
    """
    audit = machine.run("audit", str(run.folder / "run.mcap"))
    assert audit.wait() == 0, audit.out + audit.err
    compared = re.search(r"(\d[\d,]*) decisions compared", audit.out)
    assert compared is not None, audit.out
    return int(compared[1].replace(",", "")) > 0 and "agrees: every decision" in audit.out


def status(session: Session) -> RunStatus | None:
    """How the run stands, None while its leader does not answer."""
    try:
        with session.connect(LEADER, name="test", timeout_s=1.0) as leader:
            return leader.do(run_status())
    except RobotConnectionError:
        return None


def release(session: Session) -> None:
    """End the emergency stop."""
    with session.connect(CLOCK, name="test") as clock:
        clock.do(clock_library.release())
