"""What tests of pages and examples stand on: the commands that these show, as real processes.

Everything is waited for by a condition, and each process is ended by the id under which it was started.
"""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from colony.runtime.kit.connection import Session
from colony.runtime.transport.live.robot_address import local
from colony.sim.plant.child import plant_socket
from colony.sim.plant.control import PlantControl
from tests.paths import ROOT
from tests.waiting import PATIENCE_S, until

PROGRAMS = {"colony": ("-m", "colony.cli.main"), "python": ()}


class Process:
    """A command that was started. What it prints, on both streams, goes to a file. Mutable: it ends."""

    def __init__(self, command: str, environment: Mapping[str, str], log: Path, folder: Path) -> None:
        self.command = command
        self._log = log
        program, *arguments = shlex.split(command)
        with log.open("wb") as file:
            self._process = subprocess.Popen(
                [sys.executable, *PROGRAMS[program], *arguments],
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                env=environment,
                cwd=folder,
            )
        self.pid = self._process.pid

    def printed(self) -> str:
        """All that it has printed so far."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def says(self, text: str) -> None:
        """Wait until it has printed this."""
        until(lambda: text in self.printed() or self.ended is not None, f"`{text}` of {self.command}")
        assert text in self.printed(), f"{self.command} ended with {self.ended}:\n{self.printed()}"

    @property
    def ended(self) -> int | None:
        """Its exit code; None while it lives."""
        return self._process.poll()

    def result(self) -> int:
        """Its exit code, once it has ended by itself."""
        return self._process.wait(PATIENCE_S)

    def kill(self) -> None:
        """End it the hard way."""
        self._process.kill()
        self._process.wait()

    def stop(self) -> None:
        """Tell it to end."""
        if self.ended is None:
            self._process.send_signal(signal.SIGINT)

    def finish(self) -> int:
        """See to it that it has ended."""
        self.stop()
        try:
            return self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.send_signal(signal.SIGABRT)  # prints where each thread is
            self._process.wait()
            raise AssertionError(f"{self.command} did not end:\n{self.printed()}") from None


class Machine:
    """A machine with nothing on it but what is started here. Mutable: the processes.

    `folder` is where commands are run, `environment` what they see: a run directory of their own.
    """

    def __init__(self, scratch: Path, folder: Path) -> None:
        self.folder = folder
        self.scratch = scratch
        self.processes: list[Process] = []
        self.environment = {
            **os.environ,
            "COLONY_RUN_DIR": str(scratch / "run"),
            "XDG_STATE_HOME": str(scratch / "state"),
            "PYTHONPATH": str(ROOT),
            "PYTHONUNBUFFERED": "1",
            "PYTHONFAULTHANDLER": "1",
        }

    def start(self, command: str) -> Process:
        """Start a command, as a shell would: `colony ...` or `python ...`."""
        log = self.scratch / f"{len(self.processes)}.log"
        process = Process(command, self.environment, log, self.folder)
        self.processes.append(process)
        return process

    def there(self, robot: str, *servers: str) -> None:
        """Wait until these servers answer."""
        folder = local(robot, self.environment).directory.path
        until(folder.is_dir, f"the folder of {robot}")
        with Session.open(robot, environment=self.environment) as session:
            until(lambda: set(servers) <= set(session.servers()), f"{', '.join(servers)} of {robot}")

    def plant(self, robot: str) -> PlantControl:
        """What is true of a simulated robot."""
        return PlantControl(plant_socket(local(robot, self.environment).directory.path))

    def run(self, command: str) -> Process:
        """Start a command and wait for its end."""
        process = self.start(command)
        process.result()
        return process

    def end(self) -> None:
        """End whatever lives, those that came last first."""
        living = [process for process in reversed(self.processes) if process.ended is None]
        with ExitStack() as killed:
            for process in living:
                killed.callback(process.kill)
                process.stop()
            for process in living:
                process.finish()


@contextmanager
def machine(folder: Path = ROOT) -> Iterator[Machine]:
    """A machine for the length of the block; its paths are short, as sockets need them."""
    scratch = Path(tempfile.mkdtemp(prefix="colony-", dir="/tmp"))
    made = Machine(scratch, folder)
    try:
        yield made
    except BaseException:
        for process in made.processes:
            print(f"--- {process.command}\n{process.printed()}", file=sys.stderr)
        raise
    finally:
        try:
            made.end()
        finally:
            shutil.rmtree(scratch)
