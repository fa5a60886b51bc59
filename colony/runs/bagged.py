"""A program in the shadow of a robot whose topics are in a bag: as fast as it can, without ROS.

Readings go the way that they go live: through the drivers, the body and the servers' readers into the frames
of a shadow. The commands in the bag are those of the controller that drove the robot.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from colony.body.reader import read_body
from colony.execute.compiled import Compiled
from colony.ir.servers import RSERVER
from colony.ros2.bags import BEGIN_NS, Bag, BagConnection, BagError, resolved, types_of
from colony.ros2.connection import NodeSettings
from colony.ros2.drivers import Ros2Base, Ros2Device
from colony.runs.described import DescribedRobot
from colony.runs.recording import LiveRun, RunRecording, recording_into
from colony.runs.ros2_devices import BASE, commanded_topics, is_on_topics
from colony.runs.spec import MisuseError, RunReport, RunSpec, UserInterface
from colony.runtime.assembly.controller import Controller
from colony.runtime.assembly.processes.hardware import HardwareBase
from colony.runtime.assembly.processes.jobs import RobotDevices
from colony.runtime.assembly.processes.window import RecordingWindow
from colony.runtime.assembly.shadow import Shadow
from colony.runtime.kit.devices import DeviceReader
from colony.runtime.kit.read_only import BaseReader, ListeningReader
from colony.runtime.observe.comparison import ControllerComparison
from colony.runtime.observe.summary import Tally
from colony.runtime.protocol.bindings import bind, bound_servers
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.messages import ServerFrame, Tick
from colony.text.diagnostics import Diagnostic, DiagnosticError, error
from colony.text.wording import listed


class BagSpec(NamedTuple):
    """A run in a bag: its path, the tolerance of equal commands in percent, and what may not be judged.

    `unjudged` returns the contracts that the commands of these actuators cannot be judged by, with reasons.
    """

    path: Path
    tolerance: float
    unjudged: Callable[[tuple[str, ...]], dict[str, str]]


def run_in_bag(
    compiled: Compiled,
    described: DescribedRobot,
    devices: RobotDevices,
    spec: RunSpec,
    ui: UserInterface,
    bag_spec: BagSpec,
) -> RunReport:
    """Run a program in the shadow of the robot in a bag.

    Raises:
        MisuseError: the bag cannot be read, or the recording cannot be written.
        DiagnosticError: a topic has another type in the bag than in the body, or the program does not fit it.
    """
    try:
        with Bag(bag_spec.path) as bag:
            return _run(compiled, described, devices, spec, ui, bag_spec, bag)
    except BagError as problem:
        raise MisuseError(f"{bag_spec.path}: error: cannot read the bag: {problem}") from None


def _run(
    compiled: Compiled,
    described: DescribedRobot,
    devices: RobotDevices,
    spec: RunSpec,
    ui: UserInterface,
    bag_spec: BagSpec,
    bag: Bag,
) -> RunReport:
    for remark in bag.remarks:
        ui.report(remark)
    robot = _Robot(described, devices, bag, ui.report)
    bindings = bind(compiled.robot, described.servers)
    deployed = deployment(
        compiled,
        bindings,
        run=bag_spec.path.name,
        seed=spec.world.seed,
        servers=bound_servers(compiled.robot),
    )
    commanded = tuple(b for b in bindings.actuators if (b.server, b.command) in robot.commanded)
    topics = {b.actuator: robot.commanded[b.server, b.command] for b in commanded}
    unjudged = bag_spec.unjudged(tuple(topics))
    tally, comparison = Tally(compiled), ControllerComparison(compiled, topics, unjudged, bag_spec.tolerance)
    length_ns = bag.end_ns - bag.start_ns + 1
    if spec.length_ns is not None:
        length_ns = min(length_ns, spec.length_ns)
    window = RecordingWindow(
        length_ns,
        frame_ns=compiled.frame_ns,
        sinks=(tally, comparison, ui.progress(length_ns)),
    )
    for sink in ui.sinks:
        window.record(sink)
    shadow = Shadow(compiled, bindings, deployed, (window,), Controller(compiled, commanded, unjudged))
    recording: RunRecording | None = None
    ended: str | None = None
    with closing(shadow), ui.interruptible() as interrupted:
        if spec.record is not None:
            began = time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(bag.start_ns / 1e9))
            live = LiveRun(bag_spec.path.name, shadow=True, started=began)
            recording = recording_into(
                spec.record, compiled, seed=spec.world.seed, live=live, heard=tuple(topics)
            )
            window.record(recording)
        try:
            for message in robot.messages(compiled.frame_ns, deployed.run):
                shadow.handle(message, message.t_ns if isinstance(message, Tick) else 0)
                if window.over or interrupted() or (recording is not None and recording.truncation):
                    break
        except BagError as problem:
            if not window.begun:
                raise
            ended = f"the bag breaks off after {window.shown_ns / 1e9:.2f} s: {problem}"
    if recording is not None:
        recording.expect_frames()
        ended = recording.truncation or ended
    summary = tally.summary(
        seed=spec.world.seed, duration_s=window.shown_ns / 1e9, interrupted=interrupted(), travel=None
    )
    summary = replace(summary, broke_off=ended, shadow=True, driver_failures=robot.failures)
    return RunReport(summary, None, controller=comparison.report() if topics else None)


class _Robot:
    """The servers of a robot over a bag. Mutable: how far the bag was read.

    Attributes:
        commanded: the topic of each command that the bag has, by server and command.
    """

    def __init__(
        self, described: DescribedRobot, devices: RobotDevices, bag: Bag, report: Callable[[str], None]
    ) -> None:
        self._bag = bag
        self._connection: BagConnection | None = None
        self._readers: dict[str, ListeningReader] = {}
        self._failures: dict[str, str] = {}
        names = commanded_topics(described.body)
        self.commanded = {key: name for key, name in names.items() if name in bag.types}
        _expect_types(described, bag)
        specs = {server.name: server for server in described.servers}
        specs |= {server.name: server for server in devices.servers}
        others = [name for name in (*devices.hardware, *devices.absent) if not _is_on_topics(name, devices)]
        if others:
            report(f"{listed(others)}: not on topics, so that nothing of it is in the bag")
        absent, is_any_present = list[str](), False
        for name, hardware in devices.hardware.items():
            if name in others:
                continue
            node, topics = str(hardware.options["node"]), str(hardware.options["topics"])
            settings, given = NodeSettings(**json.loads(node)), json.loads(topics)
            connection = self._connection = self._connection or BagConnection(bag, settings)
            for topic in (*given["in"].values(), *given["out"].values()):
                full = resolved(topic["topic"], settings.name, settings.namespace)
                if full in bag.types:
                    is_any_present = True
                else:
                    absent.append(full)
            options = {"frame_ns": hardware.frame_ns, "listen": True, "connection": connection}
            if hardware.driver == BASE:
                base = Ros2Base(node, topics, **options)  # type: ignore[arg-type]
                assert devices.base is not None, "a server of a base has its limits"
                over = HardwareBase(
                    base, devices.base, hardware, origin_ns=BEGIN_NS, report=report, clock=connection.now_ns
                )
                self._readers[name] = ListeningReader(BaseReader(over), base, specs[name].commands)
            else:
                device = Ros2Device(node, topics, **options)  # type: ignore[arg-type]
                reader = DeviceReader(specs[name], device, report)
                self._readers[name] = ListeningReader(reader, device, specs[name].commands)
        if absent and not is_any_present:
            found = ", ".join(sorted(bag.types))
            raise BagError(f"it has no topic of `{described.body.robot.name}`, but {found}")
        if absent:
            report(f"the bag has no {listed(list(dict.fromkeys(absent)), 'or')}")
        self._silent = tuple(s for s in (*specs, RSERVER.name) if s not in self._readers)

    @property
    def failures(self) -> tuple[str, ...]:
        """A line for each server with the first reason why its messages were not usable."""
        return tuple(f"{server}: {text}" for server, text in self._failures.items())

    def messages(self, frame_ns: int, run: str) -> Iterator[Tick | ServerFrame]:
        """Yield the ticks of the robot, and what its servers answer.

        Raises:
            BagError: the rest of the bag cannot be read.
        """
        k = 0
        while self._connection is not None and self._connection.advance(k * frame_ns):
            t_ns = k * frame_ns
            yield Tick(k=k, t_ns=t_ns, run=run)
            for name, reader in self._readers.items():
                yield ServerFrame(server=name, k=k, fields=reader.read(t_ns))
                for failing in reader.failing[:1]:
                    self._failures.setdefault(name, failing)
            for name in self._silent:
                yield ServerFrame(server=name, k=k, fields={})
            k += 1


def _is_on_topics(server: str, devices: RobotDevices) -> bool:
    hardware = devices.hardware.get(server)
    return hardware is not None and is_on_topics(hardware)


def _expect_types(described: DescribedRobot, bag: Bag) -> None:
    """Check the types of the topics.

    Raises:
        DiagnosticError: at the keys of the body whose topics have another type in the bag.
    """
    if described.path is None:
        return
    body, file = described.body, read_body(described.path)
    wrong: list[Diagnostic] = []
    for server, table in body.servers.items():
        for key, topic in table.ros2.items():
            name, expected = resolved(topic.topic, body.ros2.name, body.ros2.namespace), types_of(topic.type)
            types = bag.types.get(name, ())
            if types and not set(types) & set(expected):
                message = f"{name} is {types[0]} in the bag; expected {listed(expected, 'or')}"
                wrong.append(error("B009", file.value("server", server, "ros2", key, "type"), message))
    if wrong:
        raise DiagnosticError(wrong)
