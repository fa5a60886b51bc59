"""RServer: the only server that moves the base, with one command per frame (thesis section 4.6.3).

The clients of the deployed program and the outside connections are arbitrated by priority, lock and emergency
stop, as at every server (`actuating.py`); what connections command are motions (`piloting.py`). Below that
are a reflex, which blocks commands that drive into a pressed bumper, and a watchdog. When no more ticks
arrive, and thus no more decisions, the watchdog stops the base two frames after the last command, even under
`idle hold`. While neither a program nor a connection commands the base, a driver that shares it with others
leaves it to them.

In frames of a run other than the deployed one, the base is stopped, and no verdict is published. A deployment
ends with the connection of its leader.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from colony.ir.servers import RSERVER
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import Dispatch
from colony.runtime.arbitration.motion import Motion
from colony.runtime.frames.publishing import FRAMES_KEPT, Fields, Publisher
from colony.runtime.library import robot
from colony.runtime.protocol.calls import CallDispatcher, CallId, NoArguments
from colony.runtime.protocol.deployment import LIMITS_RUN, ActuatorSpec, Deployment
from colony.runtime.protocol.messages import Effect, Message, Stopped, Tick
from colony.runtime.servers.actuating import CommandedActuators, Publish
from colony.runtime.servers.base import Base
from colony.runtime.servers.commanding import NotSentError
from colony.runtime.servers.drivers import BaseDriver, is_opening, problems_of, unreached_of
from colony.runtime.servers.outside_control import ActuatorState, Frames
from colony.runtime.servers.piloting import DRIVE, Pilot, base_actuator, mismatch, speeds_of, values_of

WATCHDOG_FRAMES = 2


class BaseActuator(CommandedActuators[Motion]):
    """The actuator of the base. Mutable.

    It comes to rest by the emergency stop of the base, not by its idle command.

    Args:
        base: the base.
        watchdog_ns: the time without a decision after which the base is stopped; by default two frames.
    """

    def __init__(self, base: Base, watchdog_ns: int | None) -> None:
        state = ActuatorState(server=RSERVER.name, built_in={DRIVE: base_actuator(base.limits)})
        self._base = base
        self._pilot = Pilot(state, base)
        self._fixed_watchdog_ns = watchdog_ns
        super().__init__(self._pilot, self._send)

    def start(self, now_ns: int) -> None:
        """Stop the base until the first tick."""
        super().start(now_ns)
        self._halt()

    def _tick(self, tick: Tick, now_ns: int, publish: Publish) -> Iterator[Effect]:
        if tick.k > self._state.k:
            self._base.refresh()
        return super()._tick(tick, now_ns, publish)

    # --- commands to the base ------------------------------------------------------------------------

    def _on_dispatch(self, spec: ActuatorSpec, dispatch: Dispatch, now_ns: int) -> None:
        super()._on_dispatch(spec, dispatch, now_ns)
        if dispatch.values is None and (dispatch.hold is not None or dispatch.outside is not None):
            self._halt()

    def _send(self, spec: ActuatorSpec, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        """Send a command to the base.

        Raises:
            NotSentError: the tick is too old, or the driver failed, and the base was stopped; or a bumper
                blocks the velocity.
        """
        if self._emergency.stopped is not None:
            self._halt()
            return
        if self._acting.get(DRIVE) is None and self._state.run in (None, LIMITS_RUN) and self._base.rest():
            return
        if self._state.is_stale(now_ns):
            self._halt()
            raise NotSentError("no command was sent, as the tick came too late", instead=spec.idle)
        outside = self._pilot.speeds
        speeds = speeds_of(spec, values) if outside is None else outside
        if speeds.velocity:
            self._base.refresh()
        if outside is not None and self._pilot.stops_immediately:
            self._base.stop(now_ns)
            return
        try:
            bumper = self._base.drive(speeds, now_ns)
        except NotSentError as problem:
            self._halt()
            raise NotSentError(str(problem), instead=spec.idle) from None
        if bumper is not None:
            if outside is not None:
                self._pilot.on_bumper(self._acting[DRIVE], bumper)
            why = f"{speeds.velocity:g} mm/s was not sent, as the {bumper} bumper is pressed"
            raise NotSentError(why, instead=values_of(spec, speeds._replace(velocity=0.0)), is_limited=True)

    # --- rest ----------------------------------------------------------------------------------------

    def _halt(self) -> None:
        self._commands.note_halted()
        self._base.stop()

    def _halt_all(self, now_ns: int) -> Iterable[Effect]:
        self._halt()
        return ()

    def _halt_program(self, now_ns: int) -> Iterable[Effect]:
        return ()  # the base goes on until the next frame, which decides or stops it

    def _rest(self, before: Frames, now_ns: int) -> Iterable[Effect]:
        self._commands.note_halted()
        if not self._base.rest():
            self._base.stop()
        self._acting.clear()
        return ()

    def _on_emergency(self, stopped: Stopped | None) -> None:
        note = "the emergency stop was released"
        if stopped is not None:
            note = f"emergency stop by {stopped.by}"
            self._halt()
            self._outside.stop()
        for dispatcher in self._dispatchers:
            for spec in dispatcher.actuators:
                dispatcher.add_note(spec.name, note)

    def check_watchdog(self, now_ns: int) -> Iterable[Effect]:
        """Stop the base if its watchdog is due, which commands feed; else keep a wake scheduled for it."""
        commanded_ns = self._base.commanded_ns
        if commanded_ns is None:
            return ()
        due_ns = commanded_ns + (self._fixed_watchdog_ns or WATCHDOG_FRAMES * self._state.frame_ns)
        if now_ns < due_ns:
            return self._watchdog_wakes.request(due_ns, now_ns)
        return self._halt_all(now_ns)

    # --- calls ---------------------------------------------------------------------------------------

    def _mismatch(self, specs: tuple[ActuatorSpec, ...]) -> str | None:
        return mismatch(specs, self._base.limits)

    def _on_leader_lost(self, now_ns: int) -> None:
        self.activate(None, now_ns)

    def _arbitration(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> robot.BaseArbitration:
        low, high = self._pilot.ends
        return robot.BaseArbitration(
            run=self._state.run or "",
            acting=self._acting.get(DRIVE),
            actuators=tuple(
                robot.BaseActuatorReport(
                    name=report.name, frames=report.frames, clients=report.clients, last_note=report.last_note
                )
                for dispatcher in self._dispatchers
                for report in dispatcher.reports({})
            ),
            sent=self._base.setting,
            low=low,
            high=high,
            **self._parties(now_ns),
        )


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
        self._actuators = BaseActuator(self._base, watchdog_ns)
        self._publisher = Publisher(
            self.address, self._read, frames_kept=frames_kept, stopped=lambda: self._actuators.stopped
        )
        self._calls = CallDispatcher(
            self.address,
            (*self._actuators.methods, *self._base.methods),
            on_lost=self._actuators.on_lost,
            stop=self._actuators.stop,
            unreached=lambda: unreached_of(driver),
            other_limit_messages=lambda: self._publisher.limit_messages,
            failing=lambda: problems_of(driver),
            opening=lambda: is_opening(driver),
        )
        self._now_ns = 0
        if deployment is not None:
            self._actuators.activate(deployment, 0)
        self.listens = (*self._publisher.listens, *self._actuators.listens, *self._calls.listens)

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Stop the base until the first tick."""
        self._actuators.start(now_ns)
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle a message, and carry out its commands."""
        self._now_ns = now_ns
        yield from self._actuators.handle(message, now_ns, self._publisher.handle, self._calls)
        yield from self._actuators.check_watchdog(now_ns)  # whatever the message
        yield from self._calls.answer_stops(now_ns)

    def close(self) -> None:
        """Stop the base."""
        self._actuators.close(self._now_ns)

    def _read(self, tick: Tick) -> Fields:
        return {**self._base.fields(tick.t_ns), **self._actuators.fields(tick)}
