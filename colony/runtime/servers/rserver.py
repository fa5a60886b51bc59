"""RServer: the base of the robot (thesis section 4.6.3). It alone moves it, by one command a frame.

The clients of the deployed program, and connections from outside, are arbitrated by priority, lock and
emergency stop (`arbiter.py`, `piloting.py`). Below that are a reflex, which sends no command that goes into a
pressed bumper, and a watchdog: when no command is decided any more, because the ticks stop, the base is
stopped two frames after the last one; so is one whose idle command is to hold.

Frames belong to a run. In frames of another run than the deployed one, the base is stopped, and no verdict is
published. If nothing is deployed, the built-in actuator `drive` is arbitrated among connections alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import Dispatch, timing
from colony.runtime.arbitration.motion import Seen, Speeds
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.frames.publishing import FRAMES_KEPT, Fields, Publisher
from colony.runtime.library import robot
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import Asked, CallDesk, Method, Nothing, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import DEPLOYMENT_BYTES, ActuatorTable, Deployment
from colony.runtime.protocol.fields import RSERVER
from colony.runtime.protocol.leadership import Leadership
from colony.runtime.protocol.messages import (
    Alive,
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
from colony.runtime.servers.base import Base
from colony.runtime.servers.base_actuator import base_actuator, misfit, speeds_of
from colony.runtime.servers.commanding import ActuatorCounts, CommandDesk
from colony.runtime.servers.drivers import BaseDriver
from colony.runtime.servers.piloting import Bumper, Pilot

WATCHDOG_FRAMES = 2

STALE_FRAMES = 2
"""Age in frames at which a tick is too old to move the base by.

This process was suspended, and a stop that it has not received yet may have overtaken the messages that
waited for it.
"""


CLOCK_GRACE_NS = 2_000_000_000
"""Nanoseconds without a tick after which calls that command motion are refused."""


class RServer:
    """The server of the base: it publishes its state, arbitrates its commands, and takes calls.

    Mutable: all of that.

    Args:
        driver: the base.
        deployment: a program that is deployed from the beginning, until another comes by the call `deploy`;
            that one stays as long as the connection which made the call.
        watchdog_ns: the time without a decision after which the base is stopped; two frames, unless given.
        keep: the number of frames kept for readers that missed one.
    """

    address = RSERVER.name

    def __init__(
        self,
        driver: BaseDriver,
        *,
        deployment: Deployment | None = None,
        watchdog_ns: int | None = None,
        keep: int = FRAMES_KEPT,
    ) -> None:
        self._base = Base(driver)
        self._emergency = StopFollower()
        self._publisher = Publisher(
            self.address, self._read, keep=keep, stopped=lambda: self._emergency.stopped
        )
        self._pilot = Pilot(self._base.limits, self._emergency, self._values, self._ticking)
        self._leadership = Leadership(self.address)
        self._leader: str | None = None
        methods = (*self._pilot.methods, *self._base.methods, *self._methods())
        self._calls = CallDesk(self.address, methods, lost=self._lost, stop=self._stop, full=self._full)
        self._watchdog_given = watchdog_ns
        self._use(deployment)
        self._k = -1
        self._tick_ns = 0
        self._began_ns = 0
        self._outside_speeds: Speeds | None = None
        self._acting: str | None = None
        self._commanded_at: int | None = None
        self._bark_at: int | None = None
        self._patience: int | None = None
        self._outbox: list[Effect] = []
        self.listens = (
            *self._publisher.listens,
            topics.requests(self.address),
            *self._calls.listens,
        )

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Stop the base, and await the first tick."""
        self._began_ns = now_ns
        self._halt()
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle a message, carry out its commands, and feed the watchdog."""
        match message:
            case Request():
                yield from self._desk.request(message, now_ns)
            case Tick():
                yield from self._tick(message, now_ns)
            case Fetch():
                yield from self._publisher.handle(message)
            case Malformed() if message.topic == topics.requests(self.address):
                self._desk.malformed(message)
            case Call() | Alive() | Malformed():
                yield from self._calls.handle(message, now_ns)
            case Wake():
                yield from self._desk.wake(now_ns)
                yield from self._calls.handle(message, now_ns)
                self._pilot.expire(now_ns)
            case _:
                return
        yield from self._follow(now_ns)
        yield from self._watch(now_ns)

    def _full(self) -> Iterable[str]:
        return self._publisher.reached

    def close(self) -> None:
        """Stop the base."""
        self._halt()

    # --- frames --------------------------------------------------------------------------------------

    def _tick(self, tick: Tick, now_ns: int) -> Iterator[Effect]:
        new = tick.k > self._k
        if new:
            self._k, self._tick_ns = tick.k, tick.t_ns
            self._follow_stop(tick)
            self._base.look()
        yield from self._publisher.handle(tick)
        if not new:
            return
        if tick.run != self._actuator.run:
            yield from self._desk.finish(now_ns)
            self._halt()
            self._acting = None
            return
        others = self._pilot.others(self._seen(now_ns), now_ns)
        yield from self._desk.tick(tick, now_ns, others)

    def _read(self, tick: Tick) -> Fields:
        return self._base.fields(tick.t_ns)

    def _seen(self, now_ns: int) -> Seen:
        """Return the input of motion laws."""
        frame_ns = self._actuator.frame_ns
        since = frame_ns if self._commanded_at is None else now_ns - self._commanded_at
        return self._base.seen(min(max(since, 0), 2 * frame_ns) / 1e9)

    # --- commands to the base ------------------------------------------------------------------------

    def _told(self, actuator: ActuatorTable, dispatch: Dispatch, now_ns: int) -> None:
        self._acting = dispatch.by if dispatch.outside is None else dispatch.outside
        self._outside_speeds = self._pilot.dispatched(dispatch.outside)
        if dispatch.outside is None and dispatch.hold != "stopped":
            self._pilot.drove(network=dispatch.by is not None)
        if dispatch.hold is not None and dispatch.values is None:
            self._halt()

    def _perform(self, actuator: ActuatorTable, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        if self._emergency.stopped is not None:
            self._halt()
            return
        if self._stale(now_ns):
            self._halt()
            note = f"frame {self._k}: nothing was sent, its tick came too late"
            self._desk.remark(self._actuator.name, note)
            return
        speeds = self._outside_speeds
        wanted = speeds_of(actuator, values) if speeds is None else speeds
        if wanted.velocity:
            self._base.look()
        bumper = self._base.drive(wanted)
        if bumper is not None:
            self._bumped(wanted, bumper, now_ns)
        self._commanded_at = now_ns

    def _ticking(self, now_ns: int) -> bool:
        """Return True if the Clock ticked recently; in lockstep the times of ticks only count frames."""
        last_ns = max(self._began_ns, self._tick_ns)
        return self._actuator.lockstep or now_ns - last_ns <= CLOCK_GRACE_NS

    def _stale(self, now_ns: int) -> bool:
        """Return True if the present frame is long over; in lockstep the times of ticks only count frames."""
        return not self._actuator.lockstep and now_ns - self._tick_ns > STALE_FRAMES * self._actuator.frame_ns

    def _bumped(self, wanted: Speeds, bumper: Bumper, now_ns: int) -> None:
        note = f"frame {self._k}: {wanted.velocity:g} mm/s was not sent, the {bumper} bumper is pressed"
        self._desk.remark(self._actuator.name, note)
        if self._outside_speeds is not None and self._acting is not None:
            self._pilot.bumped(self._acting, bumper, self._seen(now_ns))

    def _halt(self) -> None:
        self._commanded_at = self._bark_at = None
        self._base.stop()

    def _watch(self, now_ns: int) -> Iterator[Effect]:
        """Stop a base that is no longer commanded; while it is, keep one wake for this scheduled."""
        if self._commanded_at is None:
            return
        due = self._commanded_at + self._watchdog_ns
        if now_ns >= due:
            self._halt()
        elif self._bark_at is None or now_ns >= self._bark_at:
            self._bark_at = due
            yield WakeAt(due)

    def _follow(self, now_ns: int) -> Iterator[Effect]:
        """Apply the changes made by calls, and answer the calls that came to an end."""
        pilot = self._pilot
        if pilot.changed:
            pilot.changed = False
            others = pilot.others(self._seen(now_ns), now_ns)
            yield from self._desk.intervene(self._actuator.name, others, now_ns)
        if self._outbox:
            effects, self._outbox = self._outbox, []
            yield from effects
        if pilot.answers:
            answers, pilot.answers = pilot.answers, []
            yield from self._calls.settle(answers)
        due = pilot.lock.wake_at
        if due is not None and (self._patience is None or due < self._patience or now_ns >= self._patience):
            self._patience = due
            yield WakeAt(due)

    # --- the run -------------------------------------------------------------------------------------

    def _use(self, deployed: Deployment | None) -> None:
        """Arbitrate among the clients of this program, from the next tick on."""
        base = base_actuator(deployed, self._base.limits)
        self._actuator = base
        self._watchdog_ns = self._watchdog_given or WATCHDOG_FRAMES * base.frame_ns
        self._pilot.allowed, self._pilot.places = base.allowed, base.places
        times = timing(base.frame_ns, lockstep=base.lockstep)
        told, publish = self._told, base.published
        self._desk = CommandDesk((base.commanded,), times, self._perform, told=told, publish=publish)

    def _change(self, deployed: Deployment | None, now_ns: int) -> None:
        self._outbox.extend(self._desk.finish(now_ns))
        self._use(deployed)

    def _deploy(self, asked: Asked, deployed: Deployment, now_ns: int) -> None:
        where = f"{self.address}.deploy"
        wrong = misfit(deployed)
        if wrong is not None:
            raise RefusedError("deployment", f"{where}: {wrong}")
        tie = self._pilot.outsiders.tied(base_actuator(deployed, self._base.limits).places)
        if tie is not None:
            raise RefusedError("tie", f"{where}: {tie}")
        self._leadership.take(asked.caller, deployed)
        self._leader = asked.caller.connection
        if deployed.run != self._actuator.run:
            self._change(deployed, now_ns)

    def _lost(self, caller: Caller, now_ns: int) -> Iterable[Effect]:
        self._pilot.lost(caller)
        self._leadership.lost(caller)
        if caller.connection == self._leader:
            self._leader = None
            self._change(None, now_ns)
        return ()

    def _values(self, speeds: Speeds) -> tuple[float, ...]:
        return self._actuator.values(speeds)

    # --- calls ---------------------------------------------------------------------------------------

    def _methods(self) -> tuple[Method, ...]:
        return (
            method("arbitration", Nothing, self._arbitration, right="read"),
            method("deploy", Deployment, self._deploy, largest=DEPLOYMENT_BYTES),
        )

    def _stop(self, by: str, now_ns: int) -> None:
        self._halt()
        self._emergency.hear(Stopped(by=by, t_ns=now_ns))
        self._stopped(by)

    def _follow_stop(self, tick: Tick) -> None:
        """Stop or resume according to the Clock's tick."""
        before = self._emergency.stopped
        self._emergency.follow(tick)
        after = self._emergency.stopped
        if before is None and after is not None:
            self._halt()
            self._stopped(after.by)
        elif before is not None and after is None:
            self._desk.remark(self._actuator.name, "the emergency stop was released")

    def _stopped(self, by: str) -> None:
        self._pilot.stop()
        self._desk.remark(self._actuator.name, f"emergency stop by {by}")

    def _arbitration(self, asked: Asked, arguments: Nothing, now_ns: int) -> robot.Arbitration:
        lock = self._pilot.lock
        return robot.Arbitration(
            run=self._actuator.run,
            leader=self._leader,
            acting=self._acting,
            actuators=tuple(_report(counts) for counts in self._desk.counts()),
            outside=self._pilot.report(now_ns),
            lock_holder=None if lock.holder is None else lock.holder.connection,
            lock_waiting=tuple(c.connection for c in lock.waiting),
            stopped=self._emergency.stopped,
        )


def _report(counts: ActuatorCounts) -> robot.ActuatorReport:
    return robot.ActuatorReport(
        name=counts.actuator,
        frames=counts.frames,
        clients=tuple(robot.ClientReport(**client._asdict()) for client in counts.clients),
        last_note=counts.last_note,
    )
