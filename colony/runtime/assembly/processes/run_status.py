"""The state of a run, with which its leader answers queries: clients on time, late or lost, and winners."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from colony.execute.compiled import Compiled
from colony.execute.needs import BOUNDS
from colony.ir.program import Robot
from colony.ir.servers import DSERVER
from colony.ir.types import Array, Bool, element_type
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.library.leader import (
    LEADER,
    ClientStanding,
    ReadVariable,
    RunKeyframe,
    RunProgram,
    RunStatus,
    SourceText,
    Standing,
)
from colony.runtime.protocol.calls import CallDispatcher, CallId, NoArguments, RefusedError, method
from colony.runtime.protocol.deployment import Deployment, client_addresses
from colony.runtime.protocol.messages import Effect, Message, QuietNode
from colony.runtime.protocol.topics import client_address
from colony.runtime.recordings.json_text import keyframe_members
from colony.runtime.recordings.replay import site_text

MAX_SOURCE_BYTES = 2 * 1024 * 1024
"""Maximum size of source files that are sent to a reader, in bytes: half of the largest message."""


@dataclass(frozen=False, slots=True, kw_only=True)
class _Client:
    standing: Standing = "starting"
    fates: Counter[Standing] = field(default_factory=Counter)
    restarts: int = 0
    last_error: str | None = None


class RunStatusTracker:
    """A sink that counts the frames in which each client was on time, late or lost. Mutable.

    The client of an actuator's bounds is on time unless a command from outside waited for it in vain.
    """

    def __init__(
        self,
        deployment: Deployment,
        *,
        file: str,
        params: str = "",
        compiled: Compiled | None = None,
        still: Callable[[], str] = str,
    ) -> None:
        self._deployment = deployment
        self._compiled = compiled
        self._keyframe = RunKeyframe(k=-1, text="")
        self._file = file
        self._params = params
        self._still = still
        self._clients = {address: _Client() for address, _ in client_addresses(deployment)}
        self._commanded_by: dict[str, str | None] = {}
        self._k = -1
        self._frames = 0
        self._restarts = 0
        self._disagreements = 0
        self._pids: Callable[[], Mapping[str, int]] = dict
        self._faults: tuple[str, ...] = ()
        self._broken: Counter[str] = Counter()
        self._assumed = {c.name for c in compiled.contracts if c.assumed} if compiled else set()
        site = None if compiled is None else compiled.site
        self._site = () if site is None else site.values

    def set_pids(self, pids: Callable[[], Mapping[str, int]]) -> None:
        """Set the function that returns the run's live processes; it may be called in any thread."""
        self._pids = pids

    def take(self, log: RunFrame) -> None:
        """Count the fates of the clients in a frame."""
        self._frames += 1
        self._k = log.tick.k
        self._faults = tuple(r.subject for r in log.expected.records if r.kind == "sensor fault")
        if log.keyframe is not None:
            text = "{" + ", ".join(keyframe_members(log.keyframe)) + "}"
            self._keyframe = RunKeyframe(k=log.tick.k, text=text)
        self._restarts += log.restart
        self._disagreements += bool(log.disagreements)
        self._broken.update(log.breaches or ())
        for actuator, verdict in log.verdicts.items():
            self._commanded_by[actuator] = verdict.by
            bounds = client_address(actuator, BOUNDS)
            fates = {BOUNDS: "lost" if bounds in log.tick.lost else "alive", **dict(verdict.fates)}
            for module, fate in fates.items():
                client = self._clients.get(client_address(actuator, module))
                if client is not None:
                    client.standing = "late" if fate == "late" else "lost" if fate == "lost" else "alive"
                    client.fates[client.standing] += 1

    def close(self) -> None:
        """Do nothing: the counts stay."""

    @property
    def frames(self) -> int:
        """The number of frames that were decided."""
        return self._frames

    def record_death(self, clients: Iterable[str], error: str, *, restarted: bool) -> None:
        """Record that the process of these clients died.

        Args:
            clients: addresses of the clients.
            error: last line that the process printed, or the cause of its death.
            restarted: True if it is restarted.
        """
        for address in clients:
            client = self._clients[address]
            client.restarts += restarted
            client.last_error = error

    @property
    def keyframe(self) -> RunKeyframe:
        """The newest keyframe."""
        return self._keyframe

    def program(self) -> RunProgram:
        """Return the program of the run.

        Raises:
            RefusedError: the run has no source files, or they are too large for an answer.
        """
        compiled = self._compiled
        if compiled is None or not compiled.sources:
            raise RefusedError("program", "the run has no source files")
        size = sum(len(source.data) for source in compiled.sources)
        if size > MAX_SOURCE_BYTES:
            raise RefusedError("size", f"the source files have {size:,} bytes")
        return RunProgram(
            run=self._deployment.run,
            root=compiled.root,
            sources=tuple(SourceText(kind=s.kind, path=s.path, data=s.data) for s in compiled.sources),
            site="" if compiled.site is None else site_text(compiled.site),
            reads=tuple(_read_variables(compiled.robot)),
        )

    def status(self) -> RunStatus:
        """Return the state of the run."""
        return RunStatus(
            run=self._deployment.run,
            program=self._deployment.program,
            file=self._file,
            process=os.getpid(),
            k=self._k,
            frames=self._frames,
            restarts=self._restarts,
            disagreements=self._disagreements,
            commanded_by=dict(self._commanded_by),
            processes=dict(self._pids()),
            params=self._params,
            faults=self._faults,
            broken={name: n for name, n in self._broken.items() if name not in self._assumed},
            assumptions={name: n for name, n in self._broken.items() if name in self._assumed},
            site=dict(self._site),
            still=self._still(),
            clients=tuple(
                ClientStanding(
                    address=address,
                    standing=c.standing,
                    on_time=c.fates["alive"],
                    late=c.fates["late"],
                    lost=c.fates["lost"],
                    restarts=c.restarts,
                    last_error=c.last_error,
                )
                for address, c in self._clients.items()
            ),
        )


def _read_variables(robot: Robot) -> Iterator[ReadVariable]:
    for sensor in robot.sensors:
        if sensor.server == DSERVER.name and sensor.sent is None:
            yield ReadVariable(
                variable=sensor.field,
                sensor=sensor.name,
                kind="bool" if isinstance(element_type(sensor.type), Bool) else "number",
                size=sensor.type.size if isinstance(sensor.type, Array) else 0,
            )


class LeaderServer(QuietNode):
    """A server that answers with the state of the run, its program, and its newest keyframe. Mutable."""

    address = LEADER

    def __init__(self, status_tracker: RunStatusTracker) -> None:
        self._status_tracker = status_tracker
        methods = (
            method("run", NoArguments, self._run, right="read"),
            method("program", NoArguments, self._program, right="read"),
            method("keyframe", NoArguments, self._keyframe, right="read"),
        )
        self._calls = CallDispatcher(LEADER, methods)
        self.listens = self._calls.listens

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Answer a call."""
        return self._calls.handle(message, now_ns)

    def _run(self, call_id: CallId, arguments: object, now_ns: int) -> RunStatus:
        return self._status_tracker.status()

    def _program(self, call_id: CallId, arguments: object, now_ns: int) -> RunProgram:
        return self._status_tracker.program()

    def _keyframe(self, call_id: CallId, arguments: object, now_ns: int) -> RunKeyframe:
        return self._status_tracker.keyframe
