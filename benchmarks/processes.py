"""How fast a robot of processes is: frames in lockstep, many clients at one server, and the start of a run.

Everything runs over the real transport on this machine. In lockstep a frame begins as soon as the one before
it is decided: Clock, servers, each in a process of its own, ten clients, in one of their own or in that of
the run, and the observer take part in each. The robot of these frames is scripted: its devices cost nothing.
A start is that of `colony run`, with the simulator.

    python -m benchmarks.processes
"""

from __future__ import annotations

import itertools
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from types import MappingProxyType
from typing import NamedTuple

from benchmarks.scripted_servers import ScriptedDevices
from colony.body.shipped import shipped_servers
from colony.compile.pipeline import compile_program
from colony.dsl.load import check_file
from colony.execute.compiled import Compiled
from colony.ir.program import Program
from colony.ir.servers import DSERVER, RSERVER
from colony.runtime.assembly.nodes import build_observer
from colony.runtime.assembly.processes.children import Job
from colony.runtime.assembly.processes.jobs import CLIENTS as CLIENTS_WAVE
from colony.runtime.assembly.processes.jobs import (
    Layout,
    RobotDevices,
    client_processes,
    fresh_folder,
    server_parts,
    server_processes,
)
from colony.runtime.assembly.processes.run import SupervisedRun
from colony.runtime.assembly.processes.run_status import RunStatusTracker
from colony.runtime.assembly.processes.spec import Device
from colony.runtime.assembly.processes.window import RecordingWindow
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.observer import Sink
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import Bindings, bind
from colony.runtime.protocol.deployment import Deployment, deployment
from colony.runtime.protocol.messages import Effect, Message, Verdict
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import RunDirectory

Row = dict[str, object]

ROOT = Path(__file__).resolve().parent.parent
WANDER = ROOT / "behaviors" / "wander.colony"
LOOP = ROOT / "maps" / "loop.stickrep"

CLIENTS = 10
FRAMES = 3000
WARM_UP = 300
TARGET_FRAME_MS = 1000 / 300
CROWD = 100
CROWD_PROCESSES = 4
CROWD_FRAMES = 600
TARGET_CROWD_MS = 40.0
TARGET_START_S = 2.0
STARTS = 3

ROBOT = """
robot bench {
  sensor sonar[24] : mm range 0 .. 10000 from PServer.sonar
  sensor bumper    : bool from RServer.bumper
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive  idle drive(velocity = 0, turn = 0)
}
"""


def program_of(clients: int, folder: Path) -> Program:
    """A chain of suppressors: one module stands for each client, and the last of them always commands."""
    modules = [
        f"module m{i} {{ when sonar[{i % 24}] < {20_000 if i == clients - 1 else 400} mm and not bumper\n"
        f"  do drive(velocity = {10 + i % 500} mm/s, turn = 0) }}\n"
        for i in range(clients)
    ]
    chain = " suppresses ".join(f"m{i}" for i in range(clients))
    path = folder / "bench.colony"
    path.write_text(ROBOT + "".join(modules) + f"network {{ drive = {chain} }}\n")
    checked = check_file(str(path))
    assert checked.program is not None, checked.diagnostics
    return checked.program


class Times:
    """A sink: when each frame was decided, as the leader sees it. Mutable: those times."""

    def __init__(self) -> None:
        self.at: list[float] = []
        self.bad = 0

    def take(self, log: RunFrame) -> None:
        self.at.append(time.perf_counter())
        self.bad += len(log.disagreements) + sum(
            fate in ("late", "lost") for verdict in log.verdicts.values() for _, fate in verdict.fates
        )

    def close(self) -> None:
        pass


@contextmanager
def scratch() -> Iterator[Path]:
    """A folder for a run directory and all else; short, as paths of sockets have to be."""
    with tempfile.TemporaryDirectory(prefix="colony-") as name:
        yield Path(name)


@contextmanager
def robot_of(clients: int, frames: int, *sinks: Sink, lockstep: bool) -> Iterator[Bench]:
    """A scripted robot and a run of `clients` clients on it, of which none is started yet."""
    with scratch() as folder:
        program = program_of(clients, folder)
        compiled = compile_program(program).compiled
        bindings = bind(compiled.robot, shipped_servers("rome"))
        robot_address = Local(RunDirectory(folder / "r").robot("bench"))
        deployed = deployment(compiled, bindings, run="bench", seed=1, lockstep=lockstep)
        status_tracker = RunStatusTracker(deployed, file="bench.colony")
        window = RecordingWindow(
            frames * deployed.frame_ns, frame_ns=deployed.frame_ns, sinks=(*sinks, status_tracker)
        )
        with SupervisedRun(
            robot_address,
            deployed,
            (CLOCK, RSERVER.name, DSERVER.name),
            observer=build_observer(compiled, bindings, (window,), "bench"),
            window=window,
            status_tracker=status_tracker,
            report=lambda text: None,
        ) as led:
            run = fresh_folder(robot_address.directory.path / "run")
            devices = RobotDevices(base=ScriptedDevices.limits, sonars=ScriptedDevices.count)
            parts = server_parts(run, Device(plant=""), devices)
            servers = server_processes(
                robot_address, parts, run, simulator="benchmarks.scripted_servers", layout="isolated"
            )
            led.start(servers.jobs)
            yield Bench(led, robot_address, deployed, compiled, bindings, run)


class Bench(NamedTuple):
    """A run, and what its clients need to know."""

    led: SupervisedRun
    robot_address: Local
    deployed: Deployment
    compiled: Compiled
    bindings: Bindings
    folder: Path


def frames_in_lockstep(layout: Layout) -> Times:
    """Return the times of frames, each as soon as the one before it is decided; all clients share a process,
    or each has its own."""
    times = Times()
    with robot_of(CLIENTS, WARM_UP + FRAMES, times, lockstep=True) as bench:
        clients = client_processes(
            bench.robot_address, bench.deployed, bench.compiled, bench.bindings, bench.folder, layout=layout
        )
        bench.led.start(clients.jobs)
        bench.led.host(clients.hosted)
        bench.led.follow(lambda: False)
    return times


class Decided:
    """A node that notes how long after its tick each verdict arrived. Mutable: the times in ms, and how many
    clients were late or lost."""

    address = "Decided"
    listens = (topics.VERDICTS,)

    def __init__(self) -> None:
        self.ms: list[float] = []
        self.bad = 0

    def start(self, now_ns: int) -> Iterable[Effect]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, Verdict):
            self.ms.append((now_ns - message.t_ns) / 1e6)
            self.bad += sum(fate in ("late", "lost") for _, fate in message.fates)
        return ()

    def close(self) -> None:
        pass


def crowd_at_one_server() -> Decided:
    """A hundred clients' requests from a few processes, in frames of 50 ms."""
    decided = Decided()
    with robot_of(CROWD, CROWD_FRAMES, lockstep=False) as bench:
        size = CROWD // CROWD_PROCESSES
        for first in range(0, CROWD, size):
            numbers = map(str, (first, first + size, CROWD))
            bench.led.start([_crowd_job(bench, f"crowd-{first}", *numbers)])
        host = Host.open(bench.robot_address, [decided])
        thread = Thread(target=host.run)
        thread.start()
        try:
            bench.led.follow(lambda: False)
        finally:
            host.stop()
            thread.join()
            host.close()
    return decided


def _crowd_job(bench: Bench, name: str, *numbers: str) -> Job:
    return Job(
        name=name,
        module="benchmarks.crowd",
        arguments=(
            str(bench.robot_address.directory.path),
            bench.robot_address.robot,
            bench.deployed.run,
            *numbers,
        ),
        log=bench.folder / f"{name}.log",
        wave=CLIENTS_WAVE,
        essential=True,
    )


def colony_run(
    behavior: Path,
    folder: Path,
    *options: str,
    modules: tuple[str, ...] = ("colony.cli.main",),
    environment: Mapping[str, str] = MappingProxyType({}),
) -> subprocess.Popen[bytes]:
    """Start `colony run --processes` of a behavior in the building with a loop, by `python -m MODULES`.

    Its run directory is `folder / "r"`; `environment` is added to that of this process.
    """
    arguments = ["run", str(behavior), "--map", str(LOOP), "--processes", "--no-picture", *options]
    return subprocess.Popen(
        [sys.executable, "-m", *modules, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **environment, "COLONY_RUN_DIR": str(folder / "r"), "PYTHONPATH": str(ROOT)},
    )


def expect_alive(process: subprocess.Popen[bytes]) -> None:
    """Check that a run goes on.

    Raises:
        RuntimeError: it has ended.
    """
    if process.poll() is not None:
        raise RuntimeError(f"the run ended with {process.returncode}")


def start_of_a_run() -> float:
    """Seconds from the start of `colony run --processes` to the first frame that was decided."""
    with scratch() as folder:
        record = folder / "run.jsonl"
        begin = time.perf_counter()
        run = colony_run(WANDER, folder, "--duration", "0.5", "--record", str(record))
        while not (record.exists() and record.stat().st_size):
            expect_alive(run)
            time.sleep(0.001)
        took = time.perf_counter() - begin
        run.wait()
        return took


def run() -> list[Row]:
    """Measure; a row has name, value, unit, target, ok and note. `target` is the most that `value` may be."""
    start_of_a_run()  # what is compiled and cached once is not counted
    start_s = statistics.median(start_of_a_run() for _ in range(STARTS))
    apart = frames_in_lockstep("isolated")
    gaps = _gaps(apart)
    mean_ms = statistics.fmean(gaps) * 1e3
    together = frames_in_lockstep("hosted")
    together_ms = statistics.fmean(_gaps(together)) * 1e3
    crowd = crowd_at_one_server()
    ms = sorted(crowd.ms)
    return [
        row(
            f"a frame of {CLIENTS} clients, in a process of their own",
            mean_ms,
            "ms",
            TARGET_FRAME_MS,
            f"{1e3 / mean_ms:.0f} frames/s",
        ),
        row("its median", statistics.median(gaps) * 1e3, "ms", None, ""),
        row("its 99th percentile", _p99(gaps) * 1e3, "ms", None, f"{apart.bad} late or lost"),
        row(
            "the same clients in that of the run, the default",
            together_ms,
            "ms",
            None,
            f"{together_ms / mean_ms:.2f} times as long; {together.bad} late or lost",
        ),
        row(f"{CROWD} clients: median", statistics.median(ms), "ms", None, "from tick to verdict"),
        row(
            f"{CROWD} clients: 99th percentile", _p99(ms), "ms", TARGET_CROWD_MS, f"{crowd.bad} late or lost"
        ),
        row("start to first frame", start_s, "s", TARGET_START_S, "colony run --processes"),
    ]


def _gaps(times: Times) -> list[float]:
    """Return the seconds between frames, in order of size."""
    return sorted(b - a for a, b in itertools.pairwise(times.at[WARM_UP:]))


def _p99(ordered: list[float]) -> float:
    return ordered[int(0.99 * len(ordered))]


def row(name: str, value: float, unit: str, target: float | None, note: str) -> Row:
    """Return a row of the table; `target` is the most that `value` may be."""
    ok = target is None or value <= target
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": ok, "note": note}


def busy() -> str:
    """Return how busy the machine was in the last minute, for a note."""
    return f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"


def main() -> None:
    """Print the figures as a table."""
    line = "{:32} {:>10} {:>10}  {:4} {:4} {}".format
    print(line("processes", "value", "target", "unit", "", "note"))
    for each in run():
        target = "" if each["target"] is None else f"{each['target']:.4g}"
        verdict = "ok" if each["ok"] else "MISS"
        print(line(each["name"], f"{each['value']:.4g}", target, each["unit"], verdict, each["note"]))


if __name__ == "__main__":
    main()
