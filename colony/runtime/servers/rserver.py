"""RServer: the only server that moves the base, with one command per frame (thesis section 4.6.3).

The clients of the deployed program and the outside connections are arbitrated by priority, lock and emergency
stop (`arbiter.py`, `piloting.py`). Below that are a reflex, which blocks commands that drive into a pressed
bumper, and a watchdog. When no more ticks arrive, and thus no more decisions, the watchdog stops the base two
frames after the last command, even under `idle hold`.

Frames belong to a run. In frames of a run other than the deployed one, the base is stopped, and no verdict is
published. If nothing is deployed, only connections are arbitrated, for the built-in actuator `drive`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from colony.ir.servers import RSERVER
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import Dispatch, timing
from colony.runtime.arbitration.motion import BaseObservation, Speeds
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.frames.publishing import FRAMES_KEPT, Fields, Publisher
from colony.runtime.library import robot
from colony.runtime.library.actuator import ClientReport
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import CallDispatcher, CallId, Method, NoArguments, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import MAX_DEPLOYMENT_BYTES, ActuatorSpec, Deployment
from colony.runtime.protocol.leadership import Leadership
from colony.runtime.protocol.messages import (
    Alive,
    Bounds,
    Call,
    Effect,
    Fetch,
    Malformed,
    Message,
    Request,
    Stopped,
    Tick,
    Wake,
    WakeAt,
)
from colony.runtime.servers.actuating import STALE_FRAMES
from colony.runtime.servers.base import Base
from colony.runtime.servers.base_actuator import (
    base_actuator,
    mismatch,
    sent_speeds,
    speeds_of,
    values_of,
)
from colony.runtime.servers.commanding import ActuatorCounts, CommandDispatcher, NotSentError
from colony.runtime.servers.drivers import BaseDriver, is_opening, problems_of, unreached_of
from colony.runtime.servers.outside_control import CLOCK_GRACE_NS
from colony.runtime.servers.piloting import Pilot

WATCHDOG_FRAMES = 2


class RServer:
    """The server of the base. It publishes its state, arbitrates its commands, and answers calls. Mutable.

    Args:
        driver: the base.
        deployment: the program deployed at the start. The call `deploy` replaces it; the new deployment ends
            with the connection that made the call.
        watchdog_ns: the time without a decision after which the base is stopped; by default two frames.
        frames_kept: the number of frames kept for readers that missed one.
    """

    address = RSERVER.name

    def __init__(
        self,
        driver: BaseDriver,
        *,
        deployment: Deployment | None = None,
        watchdog_ns: int | None = None,
        frames_kept: int = FRAMES_KEPT,
    ) -> None:
        self._base = Base(driver)
        self._emergency = StopFollower()
        self._publisher = Publisher(
            self.address, self._read, frames_kept=frames_kept, stopped=lambda: self._emergency.stopped
        )
        self._pilot = Pilot(
            self._base.limits, self._emergency, self._values, self._is_ticking, self._base.require_state
        )
        self._leadership = Leadership(self.address)
        self._leader: str | None = None
        methods = (*self._pilot.methods, *self._base.methods, *self._methods())
        self._calls = CallDispatcher(
            self.address,
            methods,
            on_lost=self._lost,
            stop=self._stop,
            unreached=lambda: unreached_of(driver),
            other_limit_messages=self._limit_messages,
            failing=lambda: problems_of(driver),
            opening=lambda: is_opening(driver),
        )
        self._fixed_watchdog_ns = watchdog_ns
        self._activate(deployment)
        self._k = -1
        self._tick_ns = 0
        self._started_ns = 0
        self._outside_speeds: Speeds | None = None
        self._acting: str | None = None
        self._commanded_ns: int | None = None
        self._watchdog_due_ns: int | None = None
        self._lock_wake_ns: int | None = None
        self._outbox: list[Effect] = []
        self.listens = (
            *self._publisher.listens,
            topics.requests(self.address),
            *self._calls.listens,
        )

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Stop the base until the first tick."""
        self._started_ns = now_ns
        self._halt()
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle a message, carry out its commands, and feed the watchdog."""
        match message:
            case Request():
                yield from self._commands.request(message, now_ns)
            case Bounds():
                yield from self._commands.bounds(message, now_ns)
            case Tick():
                yield from self._tick(message, now_ns)
            case Fetch():
                yield from self._publisher.handle(message)
            case Malformed() if message.topic == topics.requests(self.address):
                self._commands.note_malformed(message)
            case Call() | Alive() | Malformed():
                yield from self._calls.handle(message, now_ns)
            case Wake():
                yield from self._commands.wake(now_ns)
                yield from self._calls.handle(message, now_ns)
                self._pilot.expire(now_ns)
            case _:
                return
        yield from self._apply_changes(now_ns)
        yield from self._check_watchdog(now_ns)
        yield from self._calls.answer_stops(now_ns)

    def _limit_messages(self) -> Iterable[str]:
        return self._publisher.limit_messages

    def close(self) -> None:
        """Stop the base."""
        self._halt()

    # --- frames --------------------------------------------------------------------------------------

    def _tick(self, tick: Tick, now_ns: int) -> Iterator[Effect]:
        new = tick.k > self._k
        if new:
            self._k, self._tick_ns = tick.k, tick.t_ns
            self._follow_stop(tick)
            self._base.refresh()
            yield from self._commands.end_before(tick, now_ns)
        yield from self._publisher.handle(tick)
        if not new:
            return
        if tick.run != self._actuator.run:
            yield from self._commands.finish(now_ns)
            self._halt()
            self._acting = None
            return
        interventions = self._pilot.interventions(self._observation(now_ns), now_ns)
        yield from self._commands.tick(tick, now_ns, lambda actuator: interventions)

    def _read(self, tick: Tick) -> Fields:
        return {**self._base.fields(tick.t_ns), **self._commands.fields(tick)}

    def _observation(self, now_ns: int) -> BaseObservation:
        """Return the input of the motion laws."""
        frame_ns = self._actuator.frame_ns
        elapsed_ns = frame_ns if self._commanded_ns is None else now_ns - self._commanded_ns
        return self._base.observation(min(max(elapsed_ns, 0), 2 * frame_ns) / 1e9)

    # --- commands to the base ------------------------------------------------------------------------

    def _on_dispatch(self, actuator: ActuatorSpec, dispatch: Dispatch, now_ns: int) -> None:
        self._acting = dispatch.by if dispatch.outside is None else dispatch.outside
        sent = None if dispatch.fault is not None else dispatch.values
        self._outside_speeds = self._pilot.on_dispatch(
            dispatch.outside,
            now_ns,
            lambda proposed: None if sent is None else sent_speeds(actuator, sent, proposed),
            dispatch.fault,
        )
        if dispatch.outside is None and dispatch.hold != "stopped":
            self._pilot.on_network_dispatch(active=dispatch.by is not None)
        if dispatch.values is None and (dispatch.hold is not None or dispatch.outside is not None):
            self._halt()

    def _perform(self, actuator: ActuatorSpec, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        if self._emergency.stopped is not None:
            self._halt()
            return
        if self._is_stale(now_ns):
            self._halt()
            note = f"frame {self._k}: no command was sent, as the tick came too late"
            self._commands.add_note(self._actuator.name, note)
            return
        speeds = self._outside_speeds
        requested = speeds_of(actuator, values) if speeds is None else speeds
        if requested.velocity:
            self._base.refresh()
        if speeds is not None and self._pilot.stops_immediately:
            self._base.stop()
        else:
            self._drive(actuator, requested, now_ns)
        self._commanded_ns = now_ns

    def _drive(self, actuator: ActuatorSpec, requested: Speeds, now_ns: int) -> None:
        """Send speeds to the base.

        Raises:
            NotSentError: the driver failed, and the base was stopped; or a bumper blocks the velocity.
        """
        try:
            bumper = self._base.drive(requested)
        except NotSentError as problem:
            self._halt()
            raise NotSentError(str(problem), instead=actuator.idle) from None
        if bumper is not None:
            self._commanded_ns = now_ns
            if self._outside_speeds is not None and self._acting is not None:
                self._pilot.on_bumper(self._acting, bumper, self._observation(now_ns))
            why = f"{requested.velocity:g} mm/s was not sent, as the {bumper} bumper is pressed"
            raise NotSentError(why, instead=values_of(actuator, requested._replace(velocity=0.0)))

    def _is_ticking(self, now_ns: int) -> bool:
        """Return True if the Clock ticked recently; always in lockstep, where ticks only count frames."""
        last_ns = max(self._started_ns, self._tick_ns)
        return self._actuator.lockstep or now_ns - last_ns <= CLOCK_GRACE_NS

    def _is_stale(self, now_ns: int) -> bool:
        """Return True if the current frame is long over; never in lockstep, where ticks only count frames."""
        return not self._actuator.lockstep and now_ns - self._tick_ns > STALE_FRAMES * self._actuator.frame_ns

    def _halt(self) -> None:
        self._commanded_ns = self._watchdog_due_ns = None
        self._commands.note_halted()
        self._base.stop()

    def _check_watchdog(self, now_ns: int) -> Iterator[Effect]:
        """Stop the base if its watchdog is due; else keep one wake scheduled for it."""
        if self._commanded_ns is None:
            return
        due = self._commanded_ns + self._watchdog_ns
        if now_ns >= due:
            self._halt()
        elif self._watchdog_due_ns is None or now_ns >= self._watchdog_due_ns:
            self._watchdog_due_ns = due
            yield WakeAt(due)

    def _apply_changes(self, now_ns: int) -> Iterator[Effect]:
        """Apply the changes made by calls, and answer the calls that ended."""
        pilot = self._pilot
        if pilot.changed:
            pilot.changed = False
            interventions = pilot.interventions(self._observation(now_ns), now_ns)
            yield from self._commands.intervene(self._actuator.name, interventions, now_ns)
        if self._outbox:
            effects, self._outbox = self._outbox, []
            yield from effects
        if pilot.answers:
            answers, pilot.answers = pilot.answers, []
            yield from self._calls.settle(answers)
        due = pilot.lock.wake_at
        if due is not None and (
            self._lock_wake_ns is None or due < self._lock_wake_ns or now_ns >= self._lock_wake_ns
        ):
            self._lock_wake_ns = due
            yield WakeAt(due)

    # --- the run -------------------------------------------------------------------------------------

    def _activate(self, deployed: Deployment | None) -> None:
        """Arbitrate among the clients of this program, from the next tick on."""
        actuator = base_actuator(deployed, self._base.limits)
        self._actuator = actuator
        self._watchdog_ns = self._fixed_watchdog_ns or WATCHDOG_FRAMES * actuator.frame_ns
        self._pilot.allowed, self._pilot.clients = actuator.allowed, actuator.clients
        frame_timing = timing(actuator.frame_ns, lockstep=actuator.lockstep)
        on_dispatch, publish = self._on_dispatch, actuator.published
        self._commands = CommandDispatcher(
            (actuator.spec,), frame_timing, self._perform, on_dispatch=on_dispatch, publish=publish
        )

    def _replace_deployment(self, deployed: Deployment | None, now_ns: int) -> None:
        self._outbox.extend(self._commands.finish(now_ns))
        if self._actuator.spec.limited:  # no motion goes on faster because a program died
            self._pilot.on_limits_end()
        self._activate(deployed)

    def _deploy(self, call_id: CallId, deployed: Deployment, now_ns: int) -> None:
        where = f"{self.address}.deploy"
        wrong = mismatch(deployed, self._base.limits)
        if wrong is not None:
            raise RefusedError("deployment", f"{where}: {wrong}")
        tie = self._pilot.outside_commanders.find_tie(base_actuator(deployed, self._base.limits).clients)
        if tie is not None:
            raise RefusedError("tie", f"{where}: {tie}")
        self._leadership.take(call_id.caller, deployed)
        self._leader = call_id.caller.connection
        if deployed.run != self._actuator.run:
            self._replace_deployment(deployed, now_ns)

    def _lost(self, caller: Caller, now_ns: int) -> Iterable[Effect]:
        self._pilot.on_lost(caller)
        self._leadership.on_lost(caller)
        if caller.connection == self._leader:
            self._leader = None
            self._replace_deployment(None, now_ns)
        return ()

    def _values(self, speeds: Speeds) -> tuple[float, ...]:
        return self._actuator.values(speeds)

    # --- calls ---------------------------------------------------------------------------------------

    def _methods(self) -> tuple[Method, ...]:
        return (
            method("arbitration", NoArguments, self._arbitration, right="read"),
            method("deploy", Deployment, self._deploy, max_bytes=MAX_DEPLOYMENT_BYTES),
        )

    def _stop(self, by: str, now_ns: int) -> None:
        self._halt()
        self._emergency.engage(Stopped(by=by, t_ns=now_ns))
        self._on_stopped(by)

    def _follow_stop(self, tick: Tick) -> None:
        """Stop or resume according to the Clock's tick."""
        before = self._emergency.stopped
        self._emergency.follow(tick)
        after = self._emergency.stopped
        if before is None and after is not None:
            self._halt()
            self._on_stopped(after.by)
        elif before is not None and after is None:
            self._commands.add_note(self._actuator.name, "the emergency stop was released")

    def _on_stopped(self, by: str) -> None:
        self._pilot.stop()
        self._commands.add_note(self._actuator.name, f"emergency stop by {by}")

    def _arbitration(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> robot.Arbitration:
        lock = self._pilot.lock
        return robot.Arbitration(
            run=self._actuator.run,
            leader=self._leader,
            acting=self._acting,
            actuators=tuple(_report(counts) for counts in self._commands.counts()),
            outside=self._pilot.report(now_ns),
            lock_holder=None if lock.holder is None else lock.holder.connection,
            lock_waiting=tuple(c.connection for c in lock.queue),
            stopped=self._emergency.stopped,
        )


def _report(counts: ActuatorCounts) -> robot.ActuatorReport:
    return robot.ActuatorReport(
        name=counts.actuator,
        frames=counts.frames,
        clients=tuple(ClientReport(**client._asdict()) for client in counts.clients),
        last_note=counts.last_note,
    )
