"""What processes of a robot are told, what they are made of, and what their leader knows."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.colonyc import encode, read
from colony.execute.compiled import SourceFile
from colony.ir.frame import Frame, FrameEvent, Outcome
from colony.ir.program import Program, PythonModule, Use, Wire
from colony.ir.servers import CommandSpec, FieldSpec, ParameterSpec, ServerSpec
from colony.ir.site import Site
from colony.ir.types import BOOL, DISTANCE, Array, Enum
from colony.runtime.assembly.processes.jobs import (
    Layout,
    Processes,
    RobotDevices,
    client_processes,
    fresh_folder,
    server_parts,
    server_processes,
)
from colony.runtime.assembly.processes.parts import nodes_of
from colony.runtime.assembly.processes.run_status import LeaderServer, RunStatusTracker
from colony.runtime.assembly.processes.spec import (
    Device,
    HardwareDriver,
    Spec,
    address_of,
    address_spec,
    bindings_of,
    name_of,
    read_bindings,
    read_spec,
    write_private,
    write_spec,
)
from colony.runtime.assembly.processes.window import RecordingWindow
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.leader import LEADER, RunStatus
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.deployment import Deployment, deployment
from colony.runtime.protocol.messages import Fate, Tick, Verdict
from colony.runtime.transport.live.robot_address import Credentials, Local, Remote, RobotAddress
from colony.runtime.transport.live.run_directory import RobotDirectory
from tests.kit.node_stage import NodeStage
from tests.robot_servers import ROME_SERVERS
from tests.runtime.assembly.test_virtual import pulsing
from tests.runtime.programs import roam
from tests.runtime.scripted import LIMITS, Log

PLACE = Enum("place", (("down", 0.0), ("up", 1.0)))
DEVICES = RobotDevices(
    base=LIMITS,
    sonars=24,
    servers=(
        ServerSpec("Lidar", fields=(FieldSpec("scan", Array(DISTANCE, 3), "", hold=True, blocked=(1,)),)),
        ServerSpec(
            "Lift",
            fields=(FieldSpec("moving", BOOL, ""),),
            commands=(CommandSpec("move", (ParameterSpec("place", PLACE, "", low=0.0),)),),
        ),
    ),
    hardware={
        "Lidar": HardwareDriver(driver="m:Scanner", options={"port": "/dev/x", "baud": 9600, "echo": True})
    },
    absent=("Battery",),
)
CLIENTS = ["drive/back_off", "drive/avoid", "drive/cruise"]
MS = 1_000_000
"""Nanoseconds."""


@pytest.fixture
def roaming() -> Program:
    return roam()


def deployed(of: Program) -> Deployment:
    return deployment(compile_program(of).compiled, bind(of.robot, ROME_SERVERS), run="r1", seed=1)


def processes_of(
    of: Program, robot_address: RobotAddress, folder: Path, layout: Layout = "isolated"
) -> Processes:
    compiled = compile_program(of).compiled
    return client_processes(
        robot_address,
        deployed(of),
        compiled,
        bind(of.robot, ROME_SERVERS),
        folder,
        ("modules",),
        layout=layout,
    )


def degrading(of: Program) -> Program:
    """The program, with every client in a process of its own."""
    actuators = tuple(replace(actuator, on_loss="degrade") for actuator in of.robot.actuators)
    return replace(of, robot=replace(of.robot, actuators=actuators))


def log(k: int, *fates: tuple[str, Fate], by: str | None = None, restart: bool = False) -> RunFrame:
    verdict = Verdict(k=k, t_ns=50 * MS * k, actuator="drive", by=by, values=(0.0, 0.0), fates=fates)
    return RunFrame(
        tick=Tick(k=k, t_ns=50 * MS * k),
        frame=Frame(50 * MS * k, {}),
        verdicts={"drive": verdict},
        restart=restart,
    )


# --- files ---------------------------------------------------------------------------------------


def test_a_compiled_program_comes_back_as_it_was(roaming: Program, tmp_path: Path) -> None:
    path = tmp_path / "p.colonyc"
    compiled = compile_program(roaming).compiled
    for _ in range(2):  # the second in place of the first one
        write_private(path, encode(compiled))
        write_private(bindings_of(path), msgspec.json.encode(bind(roaming.robot, ROME_SERVERS)))
    assert {file.stat().st_mode & 0o777 for file in tmp_path.iterdir()} == {0o600}
    assert read(path) == compiled
    assert read_bindings(path) == bind(roaming.robot, ROME_SERVERS)
    assert sorted(os.listdir(tmp_path)) == ["p.bindings", "p.colonyc"]


def test_a_client_does_not_begin_with_a_damaged_program(roaming: Program, tmp_path: Path) -> None:
    robot_address = Local(RobotDirectory(tmp_path, "rome"))
    (job,) = processes_of(roaming, robot_address, tmp_path).jobs
    (path,) = tmp_path.glob("*.colonyc")
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    done = subprocess.run([sys.executable, "-m", job.module, *job.arguments], capture_output=True, text=True)
    assert done.returncode != 0
    (line,) = done.stderr.splitlines()
    assert f"{path}:1:1: error[C001]" in line
    assert "damaged" in line


def test_specs_come_back_as_they_were(roaming: Program, tmp_path: Path) -> None:
    here = Local(RobotDirectory(tmp_path, "rome"))
    pem = tmp_path / "pem"
    there = Remote(
        robot="rome",
        endpoint="tls/h:1",
        credentials=Credentials(user="ada", certificate=pem, key=pem, authority=pem),
    )
    for robot_address in (here, there):
        assert address_of(address_spec(robot_address)) == robot_address
        folder = fresh_folder(tmp_path / "told")
        jobs = processes_of(degrading(roaming), robot_address, folder).jobs
        assert [job.name for job in jobs] == CLIENTS
        assert [job.clients for job in jobs] == [(client,) for client in CLIENTS]
        specs = [read_spec(Path(job.arguments[0])) for job in jobs]
        assert [name_of(spec.part) for spec in specs] == CLIENTS
        assert {address_of(spec.robot_address) for spec in specs} == {robot_address}
    for part in server_parts(
        tmp_path, Device(plant="p"), DEVICES, cameras=[("CServer", "CServer")], pinned_variables={"v": 1.0}
    ):
        write_spec(tmp_path / "s", Spec(robot_address=address_spec(here), part=part))
        assert read_spec(tmp_path / "s").part == part


def test_clients_share_a_process_of_which_each_is_known(roaming: Program, tmp_path: Path) -> None:
    robot_address = Local(RobotDirectory(tmp_path, "rome"))
    (job,) = processes_of(roaming, robot_address, tmp_path).jobs
    assert (job.name, job.clients) == ("clients", tuple(CLIENTS))
    part = read_spec(Path(job.arguments[0])).part
    assert name_of(part) == "clients"
    with ExitStack() as holds:
        nodes = nodes_of(part, robot_address, None, holds)  # type: ignore[arg-type]
    assert [node.address for node in nodes] == ["drive/back_off", "drive/avoid"]


def test_a_run_ends_with_the_shared_process_however_many_clients_it_has(
    roaming: Program, tmp_path: Path
) -> None:
    robot_address = Local(RobotDirectory(tmp_path, "rome"))
    one = replace(roaming, wires=(Wire(name="drive", actuator="drive", wiring=Use(name="cruise")),))
    for program, clients in ((roaming, CLIENTS), (one, ["drive/cruise"])):
        (shared,) = processes_of(program, robot_address, tmp_path).jobs
        assert (shared.name, list(shared.clients), shared.essential) == ("clients", clients, True)
        apart = processes_of(degrading(program), robot_address, tmp_path).jobs
        assert [job.essential for job in apart] == [False] * len(clients)


def test_only_what_may_block_is_a_process_of_its_own(tmp_path: Path) -> None:
    robot_address = Local(RobotDirectory(tmp_path, "rome"))
    parts = server_parts(tmp_path, Device(plant="p"), DEVICES, cameras=[("CServer", "CServer")])
    apart = [("CServer",), ("Lidar",)]  # a camera, and a driver of users
    names = [name_of(part) for part in parts if (name_of(part),) not in apart]
    jobs: dict[Layout, list[tuple[str, ...]]] = {
        "hosted": apart,
        "composed": [tuple(names), *apart],
        "isolated": [*((name,) for name in names), *apart],
    }
    for layout, expected in jobs.items():
        found = server_processes(robot_address, parts, tmp_path, simulator="plant", layout=layout)
        assert [(job.name, *job.others) for job in found.jobs] == expected
        assert [name_of(part) for part in found.hosted] == (names if layout == "hosted" else [])
    hosted = processes_of(pulsing(), robot_address, tmp_path, "hosted")
    assert [job.name for job in hosted.jobs] == ["DServer/activity/pulse"]
    assert [name_of(part) for part in hosted.hosted] == ["clients"]


def test_a_client_and_a_module_in_python_of_one_name_are_two_processes(tmp_path: Path) -> None:
    robot_address = Local(RobotDirectory(tmp_path, "rome"))
    program = pulsing()
    (actuator,), (use,) = program.robot.actuators, program.wires
    robot = replace(program.robot, actuators=(replace(actuator, name="activity"),))
    wire = replace(use, name="activity", actuator="activity")
    modules = tuple(
        replace(m, actuator="activity")
        if isinstance(m, PythonModule)
        else replace(m, command=replace(m.command, actuator="activity"))
        for m in program.modules
    )
    renamed = replace(program, robot=robot, wires=(wire,), modules=modules, contracts=(), limits=())
    jobs = processes_of(degrading(renamed), robot_address, tmp_path).jobs
    assert "activity/pulse" in {job.name for job in jobs}
    assert len({job.name for job in jobs}) == len({job.arguments for job in jobs}) == len(jobs)


def test_a_server_of_hardware_wants_a_driver(tmp_path: Path) -> None:
    robot_address = Local(RobotDirectory(tmp_path, "rome"))
    base = server_parts(tmp_path, Device(plant="p"), DEVICES)[1]
    with ExitStack() as holds, pytest.raises(ValueError, match="runs with the drivers of the simulator"):
        nodes_of(base, robot_address, None, holds)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        (
            "colony.runtime.assembly.processes.child, colony.runtime.assembly.nodes",
            {"lark", "colony.dsl", "colony.verify", "numpy", "numba", "matplotlib", "sqlite3", "subprocess"},
        ),
        ("colony.sim.plant.servers", {"lark", "colony.dsl", "numpy", "numba", "matplotlib"}),
        ("colony.sim.plant.child", {"lark", "colony.dsl", "colony.compile", "matplotlib"}),
    ],
)
def test_processes_load_no_more_than_they_need(module: str, absent: set[str]) -> None:
    code = f"import {module}, sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & absent


# --- the leader ----------------------------------------------------------------------------------


def test_a_window_shows_its_part_of_a_run_with_times_from_zero() -> None:
    shown, recorded = Log(), Log()
    window = RecordingWindow(150 * MS, frame_ns=50 * MS, sinks=(shown,))
    window.record(recorded)
    for k in range(7, 12):
        assert window.over == (k > 10)
        window.take(log(k))
    assert [f.tick.k for f in shown.frames] == [f.tick.k for f in recorded.frames] == [7, 8, 9]
    assert [f.frame.t_ns for f in shown.frames] == [0, 50 * MS, 100 * MS]
    assert [f.tick.t_ns for f in shown.frames] == [0, 50 * MS, 100 * MS]
    assert [f.tick.t_ns for f in recorded.frames] == [350 * MS, 400 * MS, 450 * MS]
    assert window.shown_ns == 150 * MS
    window.close()
    assert (shown.closed, recorded.closed) == (1, 1)


def test_a_window_that_was_shut_shows_nothing_more() -> None:
    shown = Log()
    window = RecordingWindow(None, frame_ns=50 * MS, sinks=(shown,))
    assert not window.begun
    window.take(log(7))
    assert window.begun
    assert not window.over
    window.shut()
    window.take(log(8))
    assert window.over
    assert len(shown.frames) == 1


def test_sinks_are_closed_even_where_one_fails() -> None:
    class Full(Log):
        def close(self) -> None:
            raise OSError("no space left")

    first, last = Log(), Log()
    window = RecordingWindow(None, frame_ns=50 * MS, sinks=(first, Full(), last))
    with pytest.raises(OSError, match="no space left"):
        window.close()
    assert (first.closed, last.closed) == (1, 1)


def test_the_leader_counts_who_was_on_time(roaming: Program) -> None:
    status_tracker = RunStatusTracker(deployed(roaming), file="f.colony")
    status_tracker.take(log(1, ("back_off", "silent"), ("avoid", "won"), by="avoid"))
    status_tracker.take(log(2, ("back_off", "late"), ("avoid", "won"), by="avoid"))
    status_tracker.take(log(3, ("back_off", "lost"), ("avoid", "suppressed"), restart=True))
    status_tracker.record_death(
        ("drive/back_off", "drive/cruise"), "MemoryError", restarted=True
    )  # they share a process
    status_tracker.record_death((), "of a server", restarted=True)
    status = status_tracker.status()
    a, b, c = status.clients
    assert (a.address, a.standing, a.on_time, a.late, a.lost) == ("drive/back_off", "lost", 1, 1, 1)
    assert [of.restarts for of in (a, b, c)] == [1, 0, 1]
    status_tracker.record_death(("drive/cruise",), "MemoryError", restarted=False)
    assert status_tracker.status().clients[2].restarts == 1, "one that is given up is not started again"
    assert [of.last_error for of in (a, b, c)] == ["MemoryError", None, "MemoryError"]
    assert (b.address, b.standing, b.on_time, b.late, b.lost) == ("drive/avoid", "alive", 3, 0, 0)
    assert (status.k, status.frames, status.restarts) == (3, 3, 1)
    assert status.commanded_by == {"drive": None}
    assert status.process == os.getpid()


def test_the_leader_knows_the_sensors_at_fault_and_the_variables_that_the_program_reads() -> None:
    of = load_text(
        "robot r {\n sensor goal : mm default 0 from DServer.Goal\n sensor on[2] : bool from DServer.On\n"
        "actuator drive { velocity : mm/s } to RServer.drive idle drive(velocity = 0)\n}\n"
        "module go { when all(on) do drive(velocity = goal / 1 s) }\nnetwork { drive = go }\n"
    )
    source = SourceFile(kind="behavior", path="b.colony", data=b"")
    site = Site(file="lab.toml", values=(("clearance", "0.7 m"),))
    compiled = replace(compile_program(of).compiled, sources=(source,), site=site)
    tracker = RunStatusTracker(deployed(of), file="f.colony", compiled=compiled)
    assert tracker.status().site == {"clearance": "0.7 m"}
    fault = FrameEvent("sensor fault", "goal")
    for records, faults in (((fault, FrameEvent("limited", "drive.velocity")), ("goal",)), ((), ())):
        tracker.take(replace(log(1), expected=Outcome((), records)))
        assert tracker.status().faults == faults
    for breaches in (("clear",), (), ("clear", "slow")):
        tracker.take(replace(log(1), breaches=breaches))
    assert tracker.status().broken == {"clear": 2, "slow": 1}
    goal, on = tracker.program().reads
    assert (goal.variable, goal.expected, on.variable, on.expected) == (
        *("Goal", "a number"),
        *("On", "a list of 2 bools"),
    )
    assert all(map(goal.fits, (1, 2.5, None)))
    assert not any(map(goal.fits, ("200", True, [1], {})))
    assert all(map(on.fits, ([True, False], None)))
    assert not any(map(on.fits, (True, [True], [1, 0], "x", [True, "x"])))


def test_the_leader_answers(roaming: Program) -> None:
    server = LeaderServer(RunStatusTracker(deployed(roaming), file="f.colony"))
    status = NodeStage(server).connect().do(CallRequest("run", NoArguments(), RunStatus, "read"))
    assert server.address == LEADER
    assert (status.run, status.frames, status.k) == ("r1", 0, -1)
    assert {c.standing for c in status.clients} == {"starting"}
