"""The parts of a robot whose nodes share a process: they start together, and a part that fails starts again.

A node that raises an exception takes those of its own part along, because they share what they know; the
other parts go on. What the new nodes have to know they learn as after the restart of a process: from the
store, from checkpoints, and from what the others tell the Clock.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from threading import Event, Thread

from colony.execute.compiled import Compiled
from colony.files import is_out_of_memory
from colony.runtime.assembly.limits import CALL_TIMEOUT_S, lead_limits
from colony.runtime.assembly.processes.parts import nodes_of, read_program
from colony.runtime.assembly.processes.restarts import Restarts
from colony.runtime.assembly.processes.spec import DriverFactory, LimitsPart, SinglePart
from colony.runtime.kit.connection import Session
from colony.runtime.kit.hub import Hub
from colony.runtime.kit.script_live import run_script
from colony.runtime.protocol.messages import Node
from colony.runtime.store.store import StoreError
from colony.runtime.transport.live.host import Host, Replacement
from colony.runtime.transport.live.outbox import Report
from colony.runtime.transport.live.robot_address import RobotAddress

# --- limits leader -------------------------------------------------------------------------------------
#
# The thread that keeps the limits of a robot's description deployed, in the process of their clients.


@contextmanager
def leading_limits(host: Host, compiled: Compiled, report: Report) -> Iterator[None]:
    """Lead the limits inside the `with`. A failure stops the host, and is raised at the end.

    Raises:
        Exception: as raised by the script, which handles refusals and lost connections itself.
    """
    stop, failures = Event(), list[BaseException]()

    def lead() -> None:
        try:
            script = lead_limits(compiled, report)
            run_script(session, script, name="limits", stop=stop, timeout_s=CALL_TIMEOUT_S)
        except BaseException as failure:
            failures.append(failure)
            host.stop()

    with Session(Hub(host.network)) as session:
        thread = Thread(target=lead, name="limits", daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()
    if failures:
        raise failures[0]


# --- hosting -------------------------------------------------------------------------------------------


SWITCH_INTERVAL_S = 0.0005
"""Seconds after which a thread that runs Python gives way to another one, a tenth of Python's default.

An emergency stop takes several turns of its thread, each behind one of the thread that receives a flood.
"""

TRACE_LINES = 8
"""Maximum number of lines that are shown of where a node failed."""

OnPartFailure = Callable[[SinglePart, str, bool], None]
"""A function that takes a part that failed, the reason in a line, and True if it starts again."""


@dataclass(frozen=False, slots=True)
class _Hosted:
    part: SinglePart
    resources: ExitStack
    addresses: tuple[str, ...] = ()
    began_ns: int = 0
    restarts: Restarts = field(default_factory=Restarts)


class HostedParts:
    """The parts of one host. Mutable. Close it after the host.

    Args:
        robot_address: the robot.
        devices: drivers of simulated devices, if there are any.
        report: callback for messages to users, of one line or several.
        on_failure: callback for the failure of a part.
    """

    def __init__(
        self,
        robot_address: RobotAddress,
        devices: DriverFactory | None,
        report: Report,
        *,
        on_failure: OnPartFailure = lambda part, reason, restarted: None,
    ) -> None:
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._robot_address = robot_address
        self._devices = devices
        self._report = report
        self._on_failure = on_failure
        self._hosted: list[_Hosted] = []

    def build(self, parts: Iterable[SinglePart]) -> tuple[Node, ...]:
        """Return the nodes of parts.

        Raises:
            Exception: see `parts.nodes_of`.
        """
        nodes: list[Node] = []
        for part in parts:
            hosted = _Hosted(part, ExitStack())
            self._hosted.append(hosted)
            nodes += self._make(hosted)
        return tuple(nodes)

    def has(self, address: str) -> bool:
        """Return True if a node is of one of these parts."""
        return any(address in hosted.addresses for hosted in self._hosted)

    def replacement(self, address: str, problem: Exception) -> Replacement:
        """Return what takes the place of the part of the node at an address, which raised `problem`.

        Raises:
            Exception: `problem`: the process has to end, or the part has failed too often.
        """
        hosted = next(h for h in self._hosted if address in h.addresses)
        reason = f"{type(problem).__name__}: {problem}"
        now_ns = time.monotonic_ns()
        due_ns = None if _ends_process(problem) else hosted.restarts.next_start(hosted.began_ns, now_ns)
        self._on_failure(hosted.part, reason, due_ns is not None)
        if due_ns is None:
            raise problem
        self._report(_failure_text(address, problem, (due_ns - now_ns) / 1e9))
        return Replacement(hosted.addresses, due_ns - now_ns, lambda: self._restart(hosted))

    def close(self) -> None:
        """Release what the nodes held besides themselves."""
        with ExitStack() as closing:
            for hosted in self._hosted:
                closing.push(hosted.resources)

    def _restart(self, hosted: _Hosted) -> tuple[Node, ...]:
        with suppress(Exception):  # a driver that fails once more, at its end
            hosted.resources.close()
        return self._make(hosted)

    def _make(self, hosted: _Hosted) -> tuple[Node, ...]:
        nodes = nodes_of(hosted.part, self._robot_address, self._devices, hosted.resources, self._report)
        hosted.addresses = tuple(node.address for node in nodes)
        hosted.began_ns = time.monotonic_ns()
        return nodes


@contextmanager
def leading(host: Host, parts: Iterable[SinglePart], report: Report) -> Iterator[None]:
    """Lead the limits among the parts inside the `with`; `report` takes why a server refuses them."""
    with ExitStack() as resources:
        for part in parts:
            if isinstance(part, LimitsPart):
                from colony.runtime.assembly.processes.hosting import leading_limits

                resources.enter_context(leading_limits(host, read_program(part.program)[0], report))
        yield


def _ends_process(problem: Exception) -> bool:
    """Return True if a new node would not help: its store fails, or the process lacks memory."""
    return isinstance(problem, StoreError) or is_out_of_memory(problem)


def _failure_text(name: str, problem: Exception, pause_s: float) -> str:
    pause = f" in {pause_s:.2g} s" if pause_s > 0 else ""
    trace = "".join(traceback.format_exception(problem)).splitlines()[-TRACE_LINES:]
    return "\n".join((f"{name} failed; it is restarted{pause}", *(f"  {line}" for line in trace)))
