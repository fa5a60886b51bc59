"""The actuators of a server: the program or the connections that command them, the stop, and the watchdog.

A server hands its messages to `CommandedActuators`. What connections command is the server's: values of its
commands (`outside_control.py`), or motions of the base, for which RServer changes how its actuator comes to
rest (`rserver.py`).

Frames belong to a run. In frames of the deployed run, the program's clients and connections are arbitrated.
While no program is led, in frames without a run, only connections are, for the built-in actuators of the
server's commands. In frames of any other run nothing is commanded.

Actuators get their idle commands when a frame decides so, when a run ends, on an emergency stop, and when the
ticks of the Clock stop coming; for the latter two, those of the last program count after its end, too. An
actuator without an idle command keeps the program's last command, but no longer than its lease that of a
connection: then its device is made safe.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Generic, Protocol, TypeVar

from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import Dispatch, timing
from colony.runtime.library import actuator
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import CallId, Method, NoArguments, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import (
    MAX_DEPLOYMENT_BYTES,
    ActuatorSpec,
    Deployment,
    Leadership,
    actuators_of,
)
from colony.runtime.protocol.messages import (
    Bounds,
    Effect,
    Fetch,
    Malformed,
    Message,
    Request,
    Sample,
    Stopped,
    Tick,
    Wake,
    WakeSchedule,
)
from colony.runtime.servers.commanding import CommandDispatcher, Perform, mismatch
from colony.runtime.servers.outside_control import FRAME_NS, Answer, Frames, OutsideControl

WATCHDOG_DEADLINES = 3
"""Time without a tick, in frame deadlines, after which actuators become idle: two ticks were missed."""

Begin = Callable[[Deployment], Mapping[str, tuple[ScalarValue, ...]]]
"""A function that begins a run; it returns what its actuators were given before, in base units."""

Publish = Callable[[Tick | Fetch], Iterable[Effect]]
"""A function that publishes the frame of a tick, or one that was missed."""

C = TypeVar("C")


class CallHandler(Protocol):
    """The calls of a server."""

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Handle a message about a connection."""
        ...

    def settle(self, answers: Iterable[Answer]) -> Iterable[Effect]:
        """Answer calls that waited."""
        ...


class CommandedActuators(Generic[C]):
    """The actuators of one server. Mutable.

    Args:
        outside: the connections that command them.
        perform: carries out a command.
        make_safe: called with the name of a command whose actuator has no idle command: at the start, at a
            stop, when the Clock falls silent, at the end, and when a connection's command of it has ended;
            None if nothing is to do then.
        begin: called when a program is deployed.
    """

    def __init__(
        self,
        outside: OutsideControl[C],
        perform: Perform,
        *,
        make_safe: Callable[[str], None] | None = None,
        begin: Begin = lambda deployed: {},
    ) -> None:
        self._outside, self._state = outside, outside.state
        self._perform = perform
        self._make_safe = make_safe
        self._begin = begin
        self._server, self._emergency = self._state.server, self._state.emergency
        self._leadership = Leadership(self._server)
        self._newest_run = ""
        self._acting: dict[str, str | None] = {}
        self._moved: set[str] = set()  # commands sent since their devices were made safe
        self._driven: set[str] = set()  # commands that a connection gave last
        self._halt_due = False
        self._watchdog_due_ns: int | None = None
        self._watchdog_wakes, self._lock_wakes = WakeSchedule(), WakeSchedule()
        self._outbox: list[Effect] = []
        self._arbitrate((), {})
        self.listens = (topics.requests(self._server),)

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods that command the actuators, and show who does."""
        return (
            *self._outside.methods,
            method("arbitration", NoArguments, self._arbitration, right="read"),
            method("deploy", Deployment, self._deploy, max_bytes=MAX_DEPLOYMENT_BYTES),
        )

    @property
    def stopped(self) -> Stopped | None:
        """The emergency stop that keeps the actuators idle, if any."""
        return self._emergency.stopped

    def start(self, now_ns: int) -> None:
        """Begin to wait for ticks; connections may command before the first one."""
        self._state.tick_ns = now_ns
        self._make_devices_safe()

    def handle(self, message: Message, now_ns: int, publish: Publish, calls: CallHandler) -> Iterator[Effect]:
        """Handle any message to the server.

        Args:
            message: the message.
            now_ns: present time.
            publish: publishes the server's frame on a tick, and again on a fetch.
            calls: answers calls, and handles all messages that concern connections.
        """
        match message:
            case Request():
                yield from self._commands.request(message, now_ns)
            case Bounds():
                yield from self._commands.bounds(message, now_ns)
            case Malformed() if message.topic in self.listens:
                for dispatcher in self._dispatchers:
                    dispatcher.note_malformed(message)
            case Tick():
                yield from self._tick(message, now_ns, publish)
                yield from self.check_watchdog(now_ns)
            case Fetch():
                yield from publish(message)
            case Wake():
                yield from self._commands.wake(now_ns)
                self._outside.expire(now_ns)
                yield from self.check_watchdog(now_ns)
                yield from calls.handle(message, now_ns)
            case _:
                yield from calls.handle(message, now_ns)
        yield from self._carry_out(now_ns, calls)

    def stop(self, by: str, now_ns: int) -> None:
        """Stop on an emergency; the halt follows once the message is handled."""
        stopped = Stopped(by=by, t_ns=now_ns)
        self._emergency.engage(stopped)
        self._on_emergency(stopped)

    def close(self, now_ns: int) -> None:
        """Halt, because the server ends."""
        for _ in self._halt_all(now_ns):
            pass  # nobody is there to send it

    def fields(self, tick: Tick) -> dict[str, Sample | None]:
        """Return what actuators were given before the frame of a tick; see `CommandDispatcher.fields`."""
        return self._commands.fields(tick)

    # --- the run -------------------------------------------------------------------------------------

    def on_lost(self, caller: Caller, now_ns: int) -> Iterable[Effect]:
        """Handle the end of a connection."""
        self._outside.on_lost(caller)
        if self._leadership.on_lost(caller):
            self._on_leader_lost(now_ns)
        return ()

    def _on_leader_lost(self, now_ns: int) -> None:
        """End the commands that the program's limits held; its clients command on in frames of its run."""
        self._outside.end_limited()

    def activate(self, deployed: Deployment | None, now_ns: int) -> None:
        """Arbitrate among the clients of this program, or of none, from the next tick on.

        The actuators of a program that still runs get their idle commands.
        """
        state = self._state
        self._outbox.extend(self._commands.finish(now_ns))
        if state.frames == "program":
            self._outbox.extend(self._halt_program(now_ns))
        self._outside.end_limited()
        state.frames = "other"
        if deployed is None:
            state.run, state.frame_ns, state.lockstep = None, FRAME_NS, False
            self._arbitrate((), {})
        else:
            state.run, state.frame_ns, state.lockstep = deployed.run, deployed.frame_ns, deployed.lockstep
            self._arbitrate(actuators_of(deployed, self._server), self._begin(deployed))

    def _arbitrate(
        self, bound: tuple[ActuatorSpec, ...], given: Mapping[str, tuple[ScalarValue, ...]]
    ) -> None:
        """Arbitrate the actuators of a program, and the built-in ones of the commands that it does not bind.

        Without a program, the verdicts of the latter are published.
        """
        state = self._state
        state.bound = {spec.command: spec for spec in bound}
        self._timing = timing(state.frame_ns, lockstep=state.lockstep)
        free = tuple(spec for command, spec in state.built_in.items() if command not in state.bound)
        perform, on_dispatch = self._perform, self._on_dispatch
        self._ended = CommandDispatcher((), self._timing, perform)  # of a program that is over
        self._commands = CommandDispatcher(bound, self._timing, perform, on_dispatch=on_dispatch, given=given)
        self._free = CommandDispatcher(
            free, self._timing, perform, on_dispatch=on_dispatch, publish=state.run is None
        )

    # --- frames --------------------------------------------------------------------------------------

    def _tick(self, tick: Tick, now_ns: int, publish: Publish) -> Iterator[Effect]:
        """End the frame before, publish the server's frame, and begin to decide the frame of a tick."""
        state = self._state
        if tick.k <= state.k:
            yield from publish(tick)
            return
        state.k, state.tick_ns, self._newest_run = tick.k, tick.t_ns, tick.run
        before = self._emergency.stopped
        self._emergency.follow(tick)
        if (before is None) != (self._emergency.stopped is None):
            self._on_emergency(self._emergency.stopped)
        yield from self._commands.end_before(tick, now_ns)
        yield from publish(tick)
        yield from self._begin_frame(tick, now_ns)
        self._feed_watchdog(now_ns)

    def _carry_out(self, now_ns: int, calls: CallHandler) -> Iterator[Effect]:
        """Halt if it is due, apply what calls have changed, and yield what else is left to send."""
        outside = self._outside
        if self._halt_due:
            self._halt_due = False
            yield from self._halt_all(now_ns)
        if outside.changed:
            outside.changed = False
            for dispatcher in self._deciding:
                for spec in dispatcher.actuators:
                    interventions = outside.interventions(spec, now_ns)
                    yield from dispatcher.intervene(spec.name, interventions, now_ns)
        if self._outbox:
            effects, self._outbox = self._outbox, []
            yield from effects
        if outside.answers:
            answers, outside.answers = outside.answers, []
            yield from calls.settle(answers)
        if (due_ns := outside.lock.wake_at) is not None:
            yield from self._lock_wakes.request(due_ns, now_ns)

    @property
    def _dispatchers(self) -> tuple[CommandDispatcher, ...]:
        return (self._commands, self._free)

    @property
    def _deciding(self) -> tuple[CommandDispatcher, ...]:
        """The dispatchers that decide the newest frame."""
        return () if self._state.frames == "other" else self._dispatchers

    def _begin_frame(self, tick: Tick, now_ns: int) -> Iterator[Effect]:
        """Begin to decide the frame of a tick, in which the program, connections or neither may command."""
        state, before = self._state, self._state.frames
        if tick.run == state.run:
            state.frames = "program"
            yield from self._commands.tick(tick, now_ns, self._outside.interventions)
        elif tick.run == "" and (state.run is None or self._leadership.is_orphaned):
            if state.run is not None:
                ended = self._commands
                self.activate(None, now_ns)
                self._ended = ended
            state.frames = "free"
        else:
            state.frames = "other"
            yield from self._commands.finish(now_ns)
            yield from self._rest(before, now_ns)
            return
        if self._free.actuators:
            yield from self._free.tick(tick, now_ns, self._outside.interventions)

    def _rest(self, before: Frames, now_ns: int) -> Iterable[Effect]:
        """Bring the actuators to rest in a frame of another run; `before` is the kind of the frame before."""
        if before == "program":
            self._outside.end_limited()
            yield from self._halt_program(now_ns)
        self._release(tuple(self._driven))

    def _halt_program(self, now_ns: int) -> Iterable[Effect]:
        """Carry out the idle commands of the program, because its frames end."""
        yield from self._commands.halt(now_ns)
        self._driven -= {command for command, spec in self._state.bound.items() if spec.idle is not None}

    def _on_dispatch(self, spec: ActuatorSpec, dispatch: Dispatch, now_ns: int) -> None:
        command = spec.command
        self._acting[command] = dispatch.by if dispatch.outside is None else dispatch.outside
        self._outside.on_dispatch(spec, dispatch, now_ns)
        if dispatch.values is not None:
            self._moved.add(command)
            if dispatch.outside is not None:
                self._driven.add(command)
            else:
                self._driven.discard(command)
        elif dispatch.hold == "locked" or dispatch.outside is not None or command in self._driven:
            self._release((command,))

    def _release(self, commands: Iterable[str]) -> None:
        """Make the devices of commands safe that have no idle command, unless they are safe already."""
        for command in commands:
            self._driven.discard(command)
            if command in self._moved and self._make_safe is not None:
                self._make_safe(command)
            self._moved.discard(command)

    # --- stops ---------------------------------------------------------------------------------------

    def _on_emergency(self, stopped: Stopped | None) -> None:
        """Handle an emergency stop, or its release if it is None."""
        if stopped is not None:
            self._halt_due = True
            self._outside.stop()

    def _feed_watchdog(self, now_ns: int) -> None:
        """Let the watchdog wait from this tick on, if it has anything to halt."""
        if self._make_safe is not None or self._commands.can_halt or self._ended.can_halt:
            self._watchdog_due_ns = now_ns + WATCHDOG_DEADLINES * self._timing.deadline_ns

    def check_watchdog(self, now_ns: int) -> Iterable[Effect]:
        """Halt if the watchdog is due, else keep a wake scheduled for it."""
        due_ns = self._watchdog_due_ns
        if due_ns is None or now_ns < due_ns:
            return self._watchdog_wakes.request(due_ns, now_ns)
        self._watchdog_due_ns = None
        return self._halt_all(now_ns)

    def _halt_all(self, now_ns: int) -> Iterable[Effect]:
        """Carry out all idle commands, and make the devices safe that have none."""
        yield from self._commands.halt(now_ns)
        yield from self._ended.halt(now_ns)
        self._driven.clear()
        self._make_devices_safe()

    def _make_devices_safe(self) -> None:
        if self._make_safe is not None:
            halted = {spec.command for spec in self._ended.actuators if spec.idle is not None}
            for command, spec in self._state.actuators.items():
                if spec.idle is None and command not in halted:
                    self._make_safe(command)

    # --- calls ---------------------------------------------------------------------------------------

    def _deploy(self, call_id: CallId, deployed: Deployment, now_ns: int) -> None:
        where, specs = f"{self._server}.deploy", actuators_of(deployed, self._server)
        wrong = self._mismatch(specs)
        if wrong is not None:
            raise RefusedError("deployment", f"{where}: {wrong}")
        tie = self._outside.find_tie(specs)
        if tie is not None:
            raise RefusedError("tie", f"{where}: {tie}")
        self._leadership.take(call_id.caller, deployed)
        if deployed.run != self._state.run:
            self.activate(deployed, now_ns)

    def _mismatch(self, specs: tuple[ActuatorSpec, ...]) -> str | None:
        """Return the reason why the actuators of a program do not fit the server's commands, or None."""
        return mismatch(self._server, self._state.built_in, specs) if self._state.built_in else None

    def _arbitration(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> object:
        return actuator.Arbitration(
            run=self._newest_run,
            actuators=tuple(report for d in self._deciding for report in d.reports(self._acting)),
            **self._parties(now_ns),
        )

    def _parties(self, now_ns: int) -> dict[str, Any]:
        """Return what the arbitration of every server shows: who may command, and what keeps others out."""
        lock, leader = self._outside.lock, self._leadership.leader
        return {
            "leader": None if leader is None else leader.connection,
            "outside": self._outside.report(now_ns),
            "lock_holder": None if lock.holder is None else lock.holder.connection,
            "lock_waiting": tuple(caller.connection for caller in lock.queue),
            "stopped": self._emergency.stopped,
        }
