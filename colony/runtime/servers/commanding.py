"""Command handling of a server: an arbiter for each actuator, which dispatches once per frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from colony.execute.needs import BOUNDS
from colony.ir.program import sent_name
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import Arbiter, Dispatch, Event, Timing, with_notes
from colony.runtime.arbitration.ballot import NO_INTERVENTIONS, STOPPED, Interventions
from colony.runtime.library.actuator import ActuatorReport, ClientReport
from colony.runtime.protocol import topics
from colony.runtime.protocol.deployment import ActuatorSpec
from colony.runtime.protocol.messages import (
    Bounds,
    Effect,
    Fate,
    Malformed,
    Request,
    Sample,
    Send,
    Tick,
    Verdict,
)
from colony.runtime.protocol.wakes import WakeSchedule

Perform = Callable[[ActuatorSpec, tuple[ScalarValue, ...], int], None]
"""A function that carries out a command: the actuator, its fields in base units, the time.

It may raise `NotSentError`.
"""


class NotSentError(Exception):
    """A command that was not carried out; the message, for a verdict, says why.

    `instead` is what the actuator was given in its place, in base units; None if it was given nothing.
    """

    def __init__(self, message: str, *, instead: tuple[ScalarValue, ...] | None = None) -> None:
        super().__init__(message)
        self.instead = instead


OnDispatch = Callable[[ActuatorSpec, Dispatch, int], None]
"""A function called with each dispatch before it is carried out, even if it sends nothing."""


@dataclass(frozen=False, slots=True, kw_only=True)
class _Counts:
    """Counts of one actuator: its frames, its clients' failures in them, and the last note."""

    frames: int = 0
    failures: Counter[tuple[str, Fate]] = field(default_factory=Counter)
    last_note: str | None = None

    def add(self, verdict: Verdict) -> None:
        self.frames += 1
        for failure in verdict.fates:
            if failure[1] in _FAILURES:
                self.failures[failure] += 1
        if verdict.notes:
            self.last_note = verdict.notes[-1]


_FAILURES: tuple[Fate, ...] = ("late", "lost", "refused")


class CommandDispatcher:
    """The arbitration and execution of commands for a server's `actuators`. Mutable.

    `can_halt` is True if `halt` has an idle command to carry out.

    Args:
        actuators: the actuators.
        frame_timing: the deadline and grace period of their frames.
        perform: carries out a dispatched command; not called for an idle actuator declared `idle hold`.
        on_dispatch: called with every dispatch.
        publish: True to publish the verdicts.
        given: what actuators were given before, in base units.
    """

    def __init__(
        self,
        actuators: tuple[ActuatorSpec, ...],
        frame_timing: Timing,
        perform: Perform,
        *,
        on_dispatch: OnDispatch = lambda actuator, dispatch, now_ns: None,
        publish: bool = True,
        given: Mapping[str, tuple[ScalarValue, ...]] = MappingProxyType({}),
    ) -> None:
        self.actuators = actuators
        self.can_halt = any(spec.idle is not None for spec in actuators)
        self._actuators = {spec.name: spec for spec in actuators}
        self._arbiters = {spec.name: Arbiter(spec, frame_timing) for spec in actuators}
        self._clients = {
            name: {
                topics.client_address(name, client): client
                for client in (*(client for client, _ in spec.clients), BOUNDS)
            }
            for name, spec in self._actuators.items()
        }
        self._counts = {name: _Counts() for name in self._actuators}
        self._given = dict(given)
        self._perform = perform
        self._on_dispatch = on_dispatch
        self._publish = publish
        self._wakes = WakeSchedule()
        self._k = -1

    def tick(
        self,
        tick: Tick,
        now_ns: int,
        interventions: Callable[[ActuatorSpec, int], Interventions] = lambda spec, now_ns: NO_INTERVENTIONS,
    ) -> Iterable[Effect]:
        """Open the frame of every actuator, with the `interventions` that compete with its clients."""
        self._k = max(self._k, tick.k)
        for name, arbiter in self._arbiters.items():
            clients = self._clients[name]
            lost = frozenset(clients[address] for address in tick.lost if address in clients)
            intervening = interventions(self._actuators[name], now_ns)
            yield from self._carry_out(name, arbiter.open(tick, lost, now_ns, intervening), now_ns)
        yield from self._schedule_wake(now_ns)

    def end_before(self, tick: Tick, now_ns: int) -> Iterable[Effect]:
        """End the frames before a tick as they stand, so that `fields` has what they sent."""
        for name, arbiter in self._arbiters.items():
            yield from self._carry_out(name, arbiter.end_before(tick.k), now_ns)

    def fields(self, tick: Tick) -> dict[str, Sample | None]:
        """Return what the actuators' `reported` fields were given before the frame of a tick, in base units.

        Nothing is returned for an actuator that was given nothing yet, nor for a tick that arrives after a
        later one: what was given last may have been given in a frame after it.
        """
        if tick.k < self._k:
            return {}
        return {
            sent_name(name, spec.fields[i].name): Sample(given[i], tick.t_ns)
            for name, spec in self._actuators.items()
            if spec.reported and (given := self._given.get(name)) is not None
            for i in spec.reported
        }

    def note_halted(self) -> None:
        """Note that the actuators were given their idle commands, whatever was dispatched before."""
        for name, spec in self._actuators.items():
            if spec.idle is not None:
                self._given[name] = spec.idle

    def request(self, request: Request, now_ns: int) -> Iterable[Effect]:
        """Handle a client's request; ignore one for an actuator of another server."""
        arbiter = self._arbiters.get(request.actuator)
        if arbiter is not None:
            yield from self._after(request.actuator, arbiter.receive(request, now_ns), now_ns)

    def bounds(self, bounds: Bounds, now_ns: int) -> Iterable[Effect]:
        """Handle the bounds of a frame; ignore those of an actuator of another server."""
        arbiter = self._arbiters.get(bounds.actuator)
        if arbiter is not None:
            yield from self._after(bounds.actuator, arbiter.receive_bounds(bounds, now_ns), now_ns)

    def intervene(self, actuator: str, interventions: Interventions, now_ns: int) -> Iterable[Effect]:
        """Apply changed interventions to the current frame of an actuator."""
        yield from self._carry_out(
            actuator, self._arbiters[actuator].intervene(interventions, now_ns), now_ns
        )
        yield from self._schedule_wake(now_ns)

    def halt(self, now_ns: int) -> Iterable[Effect]:
        """Carry out every idle command, regardless of what the frames decide.

        Called on an emergency stop, and when no more ticks arrive.
        """
        for name, spec in self._actuators.items():
            yield from self.intervene(name, STOPPED, now_ns)
            if spec.idle is not None:
                for note in self._send(spec, spec.idle, now_ns):
                    self.add_note(name, note)

    def note_malformed(self, message: Malformed) -> None:
        """Add a note about a malformed request to the verdicts of the frame."""
        for name in self._arbiters:
            self.add_note(name, f"a request could not be read: {message.reason}")

    def add_note(self, actuator: str, note: str) -> None:
        """Add a note for users to the next verdict of an actuator."""
        self._arbiters[actuator].add_note(note)

    def wake(self, now_ns: int) -> Iterable[Effect]:
        """Decide overdue frames."""
        for name, arbiter in self._arbiters.items():
            yield from self._carry_out(name, arbiter.wake(now_ns), now_ns)
        yield from self._schedule_wake(now_ns)

    def finish(self, now_ns: int) -> Iterable[Effect]:
        """End the current frames as they stand, because no others follow."""
        for name, arbiter in self._arbiters.items():
            yield from self._carry_out(name, arbiter.finish(), now_ns)

    def reports(self, acting: Mapping[str, str | None]) -> Iterator[ActuatorReport]:
        """Yield the counts of every actuator so far; `acting` is who commands, by command."""
        for name, spec in self._actuators.items():
            counts = self._counts[name]
            clients = []
            for client, priority in spec.clients:
                late, lost, refused = (counts.failures[client, fate] for fate in _FAILURES)
                clients.append(
                    ClientReport(
                        name=client,
                        priority=priority,
                        on_time=counts.frames - late - lost - refused,
                        late=late,
                        lost=lost,
                        refused=refused,
                    )
                )
            yield ActuatorReport(
                name=name,
                command=spec.command,
                acting=acting.get(spec.command),
                frames=counts.frames,
                clients=tuple(clients),
                last_note=counts.last_note,
            )

    def _after(self, name: str, events: tuple[Event, ...], now_ns: int) -> Iterator[Effect]:
        """Carry out the events of a message, and schedule a wake if the actuator is now due earlier."""
        if events:
            yield from self._carry_out(name, events, now_ns)
        yield from self._wakes.request(self._arbiters[name].wake_at, now_ns)

    def _carry_out(self, name: str, events: tuple[Event, ...], now_ns: int) -> Iterator[Effect]:
        unsent: list[str] = []  # notes of frames whose verdict was made with the dispatch
        for event in events:
            if isinstance(event, Dispatch):
                spec = self._actuators[name]
                self._on_dispatch(spec, event, now_ns)
                if event.values is not None:
                    unsent += self._send(spec, event.values, now_ns)
            else:
                verdict, unsent = with_notes(event, unsent), []
                self._counts[name].add(verdict)
                if self._publish:
                    yield Send(topics.VERDICTS, verdict)
        for note in unsent:
            self.add_note(name, note)

    def _send(self, spec: ActuatorSpec, values: tuple[ScalarValue, ...], now_ns: int) -> tuple[str, ...]:
        """Carry out a command; return notes for the verdict, why it was not carried out."""
        before, self._given[spec.name] = self._given.get(spec.name), values
        try:
            self._perform(spec, values, now_ns)
        except NotSentError as problem:
            given = before if problem.instead is None else problem.instead
            if given is None:
                self._given.pop(spec.name, None)
            else:
                self._given[spec.name] = given
            return (f"frame {self._k}: {problem}",)
        return ()

    def _schedule_wake(self, now_ns: int) -> Iterable[Effect]:
        times = (arbiter.wake_at for arbiter in self._arbiters.values())
        due = min((t_ns for t_ns in times if t_ns is not None), default=None)
        return self._wakes.request(due, now_ns)
