"""The actuators of a server: the program that commands them, the emergency stop, and the watchdog.

A server that carries out only the commands of programs gives its messages to `CommandedActuators`. RServer,
whose base is commanded by connections as well, has its own (`rserver.py`, `piloting.py`).

Actuators get their idle commands when a frame decides so, when a run ends, on an emergency stop, and when the
ticks of the Clock stop coming.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType

from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import timing
from colony.runtime.arbitration.ballot import NO_INTERVENTIONS, STOPPED
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.protocol import topics
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import Deployment, actuators_of
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
from colony.runtime.servers.commanding import CommandDispatcher, Perform

WATCHDOG_DEADLINES = 3
"""Time without a tick, in frame deadlines, after which actuators become idle: two ticks were missed."""

STALE_FRAMES = 2
"""Age in frames above which a tick is too old to move anything.

Then the process was suspended, and may not have received a later emergency stop yet.
"""

_TIMING_WITHOUT_PROGRAM = timing(50_000_000)


class CommandedActuators:
    """The actuators that the deployed program has at one server. Mutable.

    Args:
        server: the server's name.
        perform: carries out a command.
        halt: called after the idle commands at a stop, when the Clock falls silent, and at the server's end;
            None if nothing is left to do then.
    """

    def __init__(self, server: str, perform: Perform, *, halt: Callable[[int], None] | None = None) -> None:
        self._server = server
        self._perform = perform
        self._halt = halt
        self._leadership = Leadership(server)
        self._emergency = StopFollower()
        self._run: str | None = None
        self._timing = _TIMING_WITHOUT_PROGRAM
        self._stale_ns: int | None = None
        self._commands = CommandDispatcher((), self._timing, perform)
        self._k, self._tick_ns = -1, 0
        self._in_run = False
        self._halt_due = False
        self._watchdog_due_ns: int | None = None
        self._watchdog_wake_ns: int | None = None
        self._outbox: list[Effect] = []
        self.listens = (topics.requests(server),)

    @property
    def stopped(self) -> Stopped | None:
        """The emergency stop that keeps the actuators idle, if any."""
        return self._emergency.stopped

    def is_stale(self, now_ns: int) -> bool:
        """Return True if the current frame is long over; never in lockstep, where ticks only count frames."""
        return self._stale_ns is not None and now_ns - self._tick_ns > self._stale_ns

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
                yield from self._check_watchdog(now_ns)

    def tick(self, tick: Tick, now_ns: int, publish: Callable[[Tick], Iterable[Effect]]) -> Iterator[Effect]:
        """End the frame before, publish the server's frame, and begin to decide the frame of a tick."""
        if tick.k <= self._k:
            yield from publish(tick)
            return
        self._k, self._tick_ns = tick.k, tick.t_ns
        before = self._emergency.stopped
        self._emergency.follow(tick)
        self._halt_due |= before is None and self._emergency.stopped is not None
        yield from self._commands.end_before(tick, now_ns)
        yield from publish(tick)
        was_in_run, self._in_run = self._in_run, self._run == tick.run
        if self._in_run:
            interventions = NO_INTERVENTIONS if self._emergency.stopped is None else STOPPED
            yield from self._commands.tick(tick, now_ns, interventions)
        else:
            yield from self._commands.finish(now_ns)
            if was_in_run:
                yield from self._commands.halt(now_ns)
        if self._halt is not None or self._commands.can_halt:
            self._watchdog_due_ns = now_ns + WATCHDOG_DEADLINES * self._timing.deadline_ns
            yield from self._wake_for_watchdog(self._watchdog_due_ns)

    def carry_out_halt(self, now_ns: int) -> Iterator[Effect]:
        """Halt if it is due, and yield what else is left to send; called after every message."""
        if self._halt_due:
            self._halt_due = False
            yield from self._halt_all(now_ns)
        if self._outbox:
            effects, self._outbox = self._outbox, []
            yield from effects

    def stop(self, by: str, now_ns: int) -> None:
        """Stop on an emergency; `carry_out_halt` halts."""
        self._emergency.engage(Stopped(by=by, t_ns=now_ns))
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
        """Make a caller the leader; return True if its run is new; see `Leadership.take`."""
        return self._leadership.take(caller, deployed)

    def on_lost(self, caller: Caller) -> None:
        """Handle the end of a connection; its deployment remains until another leader deploys."""
        self._leadership.on_lost(caller)

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
        if self._in_run:
            self._outbox.extend(self._commands.finish(now_ns))
            self._outbox.extend(self._commands.halt(now_ns))
            self._in_run = False
        self._run = deployed.run
        self._timing = timing(deployed.frame_ns, lockstep=deployed.lockstep)
        self._stale_ns = None if deployed.lockstep else STALE_FRAMES * deployed.frame_ns
        actuators = actuators_of(deployed, self._server)
        self._commands = CommandDispatcher(actuators, self._timing, self._perform, given=given)

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
        if self._halt is not None:
            self._halt(now_ns)
