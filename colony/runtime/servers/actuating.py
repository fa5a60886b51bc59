"""The actuators of a server: the program or the connections that command them, the stop, and the watchdog.

A server gives its messages to `CommandedActuators`. RServer, whose connections command motions, has its own
(`rserver.py`, `piloting.py`), under the same rules for connections (`outside_control.py`).

Frames belong to a run. In frames of the deployed run, the program's clients and connections are arbitrated.
While no program is led, in frames without a run, only connections are, for the built-in actuators of the
server's commands. In frames of any other run nothing is commanded.

Actuators get their idle commands when a frame decides so, when a run ends, on an emergency stop, and when the
ticks of the Clock stop coming. An actuator without an idle command keeps the program's last command, but no
longer than its lease that of a connection: then its device is made safe.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Literal

from colony.ir.servers import CommandSpec
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import Dispatch, timing
from colony.runtime.arbitration.ballot import Interventions
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.library import actuator
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import CallId, Method, NoArguments, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import ActuatorSpec, Deployment, actuators_of
from colony.runtime.protocol.leadership import Leadership
from colony.runtime.protocol.messages import (
    Bounds,
    Effect,
    Malformed,
    Request,
    Sample,
    Stopped,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.servers.built_in import built_in_actuator
from colony.runtime.servers.commanding import CommandDispatcher, Perform
from colony.runtime.servers.outside_commands import OutsideCommands, Target
from colony.runtime.servers.outside_control import CLOCK_GRACE_NS, Answer

WATCHDOG_DEADLINES = 3
"""Time without a tick, in frame deadlines, after which actuators become idle: two ticks were missed."""

STALE_FRAMES = 2
"""Age in frames above which a tick is too old to move anything.

Then the process was suspended, and may not have received a later emergency stop yet.
"""

FRAME_NS = 50_000_000
"""Frame period of a robot without a program, in nanoseconds."""

_TIMING_WITHOUT_PROGRAM = timing(FRAME_NS)

Frames = Literal["program", "free", "other"]
"""The run of the newest frame: the deployed program's, none while no program is led, or any other."""


class CommandedActuators:
    """The actuators of one server. Mutable.

    Args:
        server: the server's name.
        perform: carries out a command.
        commands: the server's commands, which connections may give without a program.
        halt: called after the idle commands at a stop, when the Clock falls silent, and at the server's end;
            None if nothing is left to do then.
        make_safe: called with the name of a command whose actuator has no idle command, when a connection's
            command of it has ended; None if nothing is to do then.
    """

    def __init__(
        self,
        server: str,
        perform: Perform,
        *,
        commands: Iterable[CommandSpec] = (),
        halt: Callable[[int], None] | None = None,
        make_safe: Callable[[str], None] | None = None,
    ) -> None:
        self._server = server
        self._perform = perform
        self._halt = halt
        self._make_safe = make_safe
        self._leadership = Leadership(server)
        self._emergency = StopFollower()
        self._built_in = {c.name: built_in_actuator(server, c, idle=None) for c in commands}
        self._bound: dict[str, ActuatorSpec] = {}
        self._run: str | None = None
        self._timing = _TIMING_WITHOUT_PROGRAM
        self._frame_ns, self._lockstep = FRAME_NS, False
        self._commands = CommandDispatcher((), self._timing, perform)
        self._free = CommandDispatcher((), self._timing, perform)
        self._outside = OutsideCommands(server, self._targets, self._emergency, self._is_ticking)
        self._k, self._tick_ns, self._newest_run = -1, 0, ""
        self._frames: Frames = "other"
        self._acting: dict[str, str | None] = {}
        self._moved: set[str] = set()  # commands sent since their devices were made safe
        self._driven: set[str] = set()  # commands that a connection gave last
        self._halt_due = False
        self._watchdog_due_ns: int | None = None
        self._watchdog_wake_ns: int | None = None
        self._lock_wake_ns: int | None = None
        self._outbox: list[Effect] = []
        self.listens = (topics.requests(server),)

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods with which connections command the actuators."""
        arbitration = method("arbitration", NoArguments, self._arbitration, right="read")
        return (*self._outside.methods, arbitration)

    @property
    def stopped(self) -> Stopped | None:
        """The emergency stop that keeps the actuators idle, if any."""
        return self._emergency.stopped

    def start(self, now_ns: int) -> None:
        """Begin to wait for ticks; connections may command before the first one."""
        self._tick_ns = now_ns

    def is_stale(self, now_ns: int) -> bool:
        """Return True if the current frame is long over; never in lockstep, where ticks only count frames."""
        if self._frames == "free":
            return now_ns - self._tick_ns > STALE_FRAMES * FRAME_NS
        return (
            self._run is not None
            and not self._lockstep
            and now_ns - self._tick_ns > STALE_FRAMES * self._frame_ns
        )

    def handle(self, message: Request | Bounds | Malformed | Wake, now_ns: int) -> Iterable[Effect]:
        """Handle a message of a client, a malformed one, or a wake."""
        match message:
            case Request():
                yield from self._commands.request(message, now_ns)
            case Bounds():
                yield from self._commands.bounds(message, now_ns)
            case Malformed():
                self._commands.note_malformed(message)
            case Wake():
                yield from self._commands.wake(now_ns)
                self._outside.expire(now_ns)
                yield from self._check_watchdog(now_ns)

    def tick(self, tick: Tick, now_ns: int, publish: Callable[[Tick], Iterable[Effect]]) -> Iterator[Effect]:
        """End the frame before, publish the server's frame, and begin to decide the frame of a tick."""
        if tick.k <= self._k:
            yield from publish(tick)
            return
        self._k, self._tick_ns, self._newest_run = tick.k, tick.t_ns, tick.run
        before = self._emergency.stopped
        self._emergency.follow(tick)
        if before is None and self._emergency.stopped is not None:
            self._halt_due = True
            self._outside.stop()
        yield from self._commands.end_before(tick, now_ns)
        yield from publish(tick)
        yield from self._begin_frame(tick, now_ns)
        if self._halt is not None or self._commands.can_halt:
            self._watchdog_due_ns = now_ns + WATCHDOG_DEADLINES * self._timing.deadline_ns
            yield from self._wake_for_watchdog(self._watchdog_due_ns)

    def carry_out(
        self, now_ns: int, settle: Callable[[Iterable[Answer]], Iterable[Effect]]
    ) -> Iterator[Effect]:
        """Halt if it is due, apply what calls have changed, and yield what else is left to send.

        To be called after every message; `settle` answers calls that waited.
        """
        if self._halt_due:
            self._halt_due = False
            yield from self._halt_all(now_ns)
        if self._outside.changed:
            self._outside.changed = False
            for dispatcher in self._dispatchers:
                for spec in dispatcher.actuators:
                    yield from dispatcher.intervene(spec.name, self._interventions(spec, now_ns), now_ns)
        if self._outbox:
            effects, self._outbox = self._outbox, []
            yield from effects
        if self._outside.answers:
            answers, self._outside.answers = self._outside.answers, []
            yield from settle(answers)
        due = self._outside.lock.wake_at
        if due is not None and (
            self._lock_wake_ns is None or due < self._lock_wake_ns or now_ns >= self._lock_wake_ns
        ):
            self._lock_wake_ns = due
            yield WakeAt(due)

    def stop(self, by: str, now_ns: int) -> None:
        """Stop on an emergency; `carry_out` halts."""
        self._emergency.engage(Stopped(by=by, t_ns=now_ns))
        self._outside.stop()
        self._halt_due = True

    def close(self, now_ns: int) -> None:
        """Halt, because the server ends."""
        for _ in self._halt_all(now_ns):
            pass  # nobody is there to send it

    def fields(self, tick: Tick) -> dict[str, Sample | None]:
        """Return what actuators were given before the frame of a tick; see `CommandDispatcher.fields`."""
        return self._commands.fields(tick)

    # --- the run -------------------------------------------------------------------------------------

    def lead(self, caller: Caller, deployed: Deployment) -> bool:
        """Make a caller the leader; return True if its run is new.

        Raises:
            RefusedError: as by `Leadership.take`, and "tie" if a connection commands with the priority of a
                client.
        """
        tie = self._outside.find_tie(actuators_of(deployed, self._server))
        if tie is not None:
            raise RefusedError("tie", f"{self._server}.deploy: {tie}")
        return self._leadership.take(caller, deployed)

    def on_lost(self, caller: Caller) -> None:
        """Handle the end of a connection; its deployment remains until another leader deploys."""
        led = self._leadership.leader
        self._outside.on_lost(caller)
        self._leadership.on_lost(caller)
        if led is not None and led.connection == caller.connection:
            self._end_limited()

    def activate(
        self,
        deployed: Deployment,
        now_ns: int,
        given: Mapping[str, tuple[ScalarValue, ...]] = MappingProxyType({}),
    ) -> None:
        """Arbitrate among the clients of this program, from the next tick on.

        The actuators of a program that still runs get their idle commands. `given` is what those of this
        program were given before, in base units.
        """
        if self._frames == "program":
            self._outbox.extend(self._commands.finish(now_ns))
            self._outbox.extend(self._halt_program(now_ns))
        self._end_limited()
        self._outbox.extend(self._free.finish(now_ns))
        self._frames = "other"
        self._run = deployed.run
        self._timing = timing(deployed.frame_ns, lockstep=deployed.lockstep)
        self._frame_ns, self._lockstep = deployed.frame_ns, deployed.lockstep
        actuators = actuators_of(deployed, self._server)
        self._bound = {spec.command: spec for spec in actuators}
        self._commands = CommandDispatcher(
            actuators, self._timing, self._perform, on_dispatch=self._on_dispatch, given=given
        )
        self._free = self._free_dispatcher()

    def _end_limited(self) -> None:
        """End the commands of connections that the limits of the program held: its run is over."""
        for spec in self._bound.values():
            if spec.limited:
                self._outside.end_limited(self._outside.contest(spec))

    # --- frames --------------------------------------------------------------------------------------

    @property
    def _dispatchers(self) -> tuple[CommandDispatcher, ...]:
        """The dispatchers that decide the newest frame."""
        match self._frames:
            case "program":
                return (self._commands, self._free)
            case "free":
                return (self._free,)
            case "other":
                return ()

    def _begin_frame(self, tick: Tick, now_ns: int) -> Iterator[Effect]:
        """Begin to decide the frame of a tick, in which the program, connections or neither may command."""
        before, after = self._frames, self._frames_of(tick)
        if after != before:
            yield from self._free.finish(now_ns)
            self._frames = after
            if before == "program":
                self._end_limited()
            self._free = self._free_dispatcher()
        if after == "program":
            yield from self._commands.tick(tick, now_ns, lambda spec: self._interventions(spec, now_ns))
        else:
            yield from self._commands.finish(now_ns)
            if before == "program":
                yield from self._halt_program(now_ns)
        yield from self._free.tick(tick, now_ns, lambda spec: self._interventions(spec, now_ns))
        if after == "other":
            self._release(tuple(self._driven))

    def _halt_program(self, now_ns: int) -> Iterator[Effect]:
        """Carry out the idle commands of the program, because its frames end."""
        yield from self._commands.halt(now_ns)
        self._driven -= {command for command, spec in self._bound.items() if spec.idle is not None}

    def _frames_of(self, tick: Tick) -> Frames:
        if tick.run == self._run:
            return "program"
        return "free" if tick.run == "" and self._leadership.leader is None else "other"

    def _free_dispatcher(self) -> CommandDispatcher:
        """Return a dispatcher for the commands that the program, if there is one, has no actuator for."""
        match self._frames:
            case "other":
                free: list[ActuatorSpec] = []
            case "free":
                free = list(self._built_in.values())
            case "program":
                free = [spec for command, spec in self._built_in.items() if command not in self._bound]
        return CommandDispatcher(
            tuple(free),
            self._timing,
            self._perform,
            on_dispatch=self._on_dispatch,
            publish=self._frames == "free",
        )

    def _targets(self) -> Mapping[str, Target]:
        bound = {} if self._frames == "free" else self._bound
        return {command: self._target(spec) for command, spec in {**self._built_in, **bound}.items()}

    def _target(self, spec: ActuatorSpec) -> Target:
        built_in = self._built_in.get(spec.command)
        named = spec if built_in is None else built_in
        names = tuple(field.name for field in named.fields)
        return Target(spec, names, tuple(range(len(names))) if built_in is None else spec.field_indices)

    def _interventions(self, spec: ActuatorSpec, now_ns: int) -> Interventions:
        return self._outside.interventions(spec.command, lambda: self._target(spec), now_ns)

    def _is_ticking(self, now_ns: int) -> bool:
        """Return True if the Clock ticked recently; always in lockstep, where ticks only count frames."""
        lockstep = self._frames == "program" and self._lockstep
        return lockstep or now_ns - self._tick_ns <= CLOCK_GRACE_NS

    def _on_dispatch(self, spec: ActuatorSpec, dispatch: Dispatch, now_ns: int) -> None:
        command = spec.command
        self._acting[command] = dispatch.by if dispatch.outside is None else dispatch.outside
        if dispatch.values is not None:
            if self._frames == "free":
                self._commands.forget_given(command)
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

    # --- the watchdog --------------------------------------------------------------------------------

    def _wake_for_watchdog(self, due_ns: int) -> Iterator[Effect]:
        """Schedule a wake, unless an earlier one is scheduled; that one schedules the next."""
        if self._watchdog_wake_ns is None or due_ns < self._watchdog_wake_ns:
            self._watchdog_wake_ns = due_ns
            yield WakeAt(due_ns)

    def _check_watchdog(self, now_ns: int) -> Iterator[Effect]:
        """Halt if no tick has come for too long."""
        if self._watchdog_wake_ns is not None and now_ns >= self._watchdog_wake_ns:
            self._watchdog_wake_ns = None
        due_ns = self._watchdog_due_ns
        if due_ns is None:
            return
        if now_ns >= due_ns:
            self._watchdog_due_ns, self._halt_due = None, True
        else:
            yield from self._wake_for_watchdog(due_ns)

    def _halt_all(self, now_ns: int) -> Iterator[Effect]:
        yield from self._commands.halt(now_ns)
        yield from self._free.halt(now_ns)
        self._driven.clear()
        if self._halt is not None:
            self._halt(now_ns)

    # --- calls ---------------------------------------------------------------------------------------

    def _arbitration(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> actuator.Arbitration:
        lock, leader = self._outside.lock, self._leadership.leader
        return actuator.Arbitration(
            run=self._newest_run,
            leader=None if leader is None else leader.connection,
            actuators=tuple(self._reports()),
            outside=self._outside.report(now_ns),
            lock_holder=None if lock.holder is None else lock.holder.connection,
            lock_waiting=tuple(c.connection for c in lock.queue),
            stopped=self._emergency.stopped,
        )

    def _reports(self) -> Iterator[actuator.ActuatorReport]:
        for dispatcher in self._dispatchers:
            for spec, counts in zip(dispatcher.actuators, dispatcher.counts(), strict=True):
                yield actuator.ActuatorReport(
                    name=counts.actuator,
                    command=spec.command,
                    acting=self._acting.get(spec.command),
                    frames=counts.frames,
                    clients=tuple(actuator.ClientReport(**client._asdict()) for client in counts.clients),
                    last_note=counts.last_note,
                )
