"""Which processes a run can do without, and what its leader tells of them: real processes, but no robot."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from colony.compile.pipeline import compile_program
from colony.ir.frame import Frame, Outcome
from colony.runtime.assembly.nodes import build_observer
from colony.runtime.assembly.processes.children import Job, RunFailedError
from colony.runtime.assembly.processes.run import SupervisedRun
from colony.runtime.assembly.processes.run_status import RunStatusTracker
from colony.runtime.assembly.processes.window import RecordingWindow
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.messages import Tick
from tests.robot_servers import ROME_SERVERS
from tests.runtime.programs import roam
from tests.runtime.transport.live.stage import robot_address, run_directory
from tests.waiting import until

NAME = "DServer/activity/rogue"

NEVER_JOINS = """
from colony.runtime.assembly.processes.shutdown import exit_with
exit_with("it cannot be imported")
"""
"""One that is given up at its first death, by its exit code; six deaths would take ten seconds."""

JOINS = """
import os, sys, threading, time
from pathlib import Path
from colony.runtime.assembly.processes.shutdown import exit_with
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import local
from tests.runtime.transport.live.stage import Recorder

go = Path(__file__).with_name("go")
with Host.open(local("rome", {"COLONY_RUN_DIR": sys.argv[1]}), [Recorder("DServer/activity/rogue")]) as host:
    threading.Thread(target=host.run, daemon=True).start()
    while not go.exists():
        time.sleep(0.005)
    exit_with("something is gone")
"""


class Led:
    """A run of which no frame is decided. Mutable: what was reported."""

    def __init__(self, folder: Path, run_folder: str) -> None:
        self.folder, self._run_folder = folder, run_folder
        compiled = compile_program(roam()).compiled
        bindings = bind(compiled.robot, ROME_SERVERS)
        deployed = deployment(compiled, bindings, run="r1", seed=1)
        self.status_tracker = RunStatusTracker(deployed, file="f.colony")
        self.window = RecordingWindow(None, frame_ns=deployed.frame_ns, sinks=(self.status_tracker,))
        self.reports: list[str] = []
        self.led = SupervisedRun(
            robot_address({"COLONY_RUN_DIR": run_folder}),
            deployed,
            (),
            observer=build_observer(compiled, bindings, (self.window,), "r1"),
            window=self.window,
            status_tracker=self.status_tracker,
            report=self.reports.append,
        )

    def begin(self) -> None:
        """Have the run begin."""
        tick, frame, outcome = Tick(k=1, t_ns=0), Frame(0, {}), Outcome((), (), ())
        log = RunFrame(tick=tick, frame=frame, verdicts={}, expected=outcome)
        self.window.take(log)
        assert self.window.begun

    def start(self, text: str, *, essential: bool = False) -> None:
        """Start a process of the run."""
        (self.folder / "rogue.py").write_text(text)
        log = self.folder / "rogue.log"
        job = Job(
            name=NAME, module="rogue", arguments=(self._run_folder,), log=log, wave=0, essential=essential
        )
        self.led.start([job])

    def has_joined(self) -> bool:
        """Whether the leader has heard of the process."""
        return NAME in self.led._joined

    def leave(self) -> None:
        """Have the process end."""
        (self.folder / "go").touch()

    def look_after(self) -> None:
        """Look after the processes until a death is reported."""
        assert self.led.wait_for(lambda: bool(self.reports), lambda: False, what="a death", timeout_s=20.0)


@pytest.fixture
def led(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Led]:
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with run_directory() as environment:
        made = Led(tmp_path, environment["COLONY_RUN_DIR"])
        with made.led:
            yield made


@pytest.mark.parametrize("begun", [False, True])
def test_one_that_never_joined_ends_the_run_whenever_it_is_given_up(led: Led, begun: bool) -> None:
    if begun:
        led.begin()
    led.start(NEVER_JOINS)
    with pytest.raises(RunFailedError, match="it cannot be imported"):
        led.look_after()


def test_one_that_took_part_is_given_up_and_the_run_goes_on(led: Led) -> None:
    led.begin()
    led.start(JOINS)
    until(led.has_joined, "it joins")
    led.leave()
    led.look_after()
    assert led.reports == [f"{NAME}: something is gone"]
    assert not led.window.over


def test_one_that_is_essential_ends_the_run_when_it_is_given_up(led: Led) -> None:
    led.begin()
    led.start(JOINS, essential=True)
    until(led.has_joined, "it joins")
    led.leave()
    with pytest.raises(RunFailedError, match="something is gone"):
        led.look_after()


def test_the_standings_have_the_processes_that_live(led: Led) -> None:
    led.begin()
    led.start(JOINS)
    until(led.has_joined, "it joins")
    assert led.status_tracker.status().processes == {NAME: led.led.pid(NAME)}
    led.leave()
    led.look_after()
    assert led.status_tracker.status().processes == {}
