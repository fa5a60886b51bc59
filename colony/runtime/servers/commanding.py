"""Command handling of a server: an arbiter for each actuator, which dispatches once per frame."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from colony.execute.needs import BOUNDS
from colony.ir.program import Actuator, ActuatorField, Role
from colony.ir.servers import CommandSpec
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import Arbiter, Dispatch, Event, Timing, had_role, with_notes
from colony.runtime.arbitration.ballot import NO_INTERVENTIONS, STOPPED, Interventions
from colony.runtime.library.actuator import ActuatorReport, ClientReport
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import ActuatorBinding
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec, actuator_spec, reported_name
from colony.runtime.protocol.messages import (
    Bounds,
    Effect,
    Fate,
    Malformed,
    Request,
    Sample,
    SendMessage,
    Tick,
    Verdict,
    WakeSchedule,
)

# --- built in ------------------------------------------------------------------------------------------
#
# The actuators that a server has by itself: connections command them while no program has its own.
#
# A program's actuator is held to the one that its command has by itself.


def built_in_actuator(
    server: str, command: CommandSpec, *, idle: tuple[ScalarValue, ...] | None
) -> ActuatorSpec:
    """Return the actuator of a command, with the name, the parameters and the ranges of the command."""
    fields = tuple(
        ActuatorField(name=p.name, type=p.type, low=p.low, high=p.high) for p in command.parameters
    )
    return actuator_spec(
        Actuator(name=command.name, fields=fields, server=server, command=command.name, idle=idle),
        ActuatorBinding(
            actuator=command.name,
            server=server,
            command=command.name,
            field_indices=tuple(range(len(fields))),
        ),
        (),
    )


def expected_of(field: ActuatorFieldSpec, value: object) -> str | None:
    """Return what a field expects in place of a value, in base units; None if it takes the value."""
    if field.kind == "bool":
        return None if isinstance(value, bool) else "a bool"
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return "a finite number"
    if field.members:
        numbers = ", ".join(f"{member:g}" for member in field.members)
        return None if value in field.members else f"the number of a member: {numbers}"
    low, high = field.low, field.high
    if (low is None or value >= low) and (high is None or value <= high):
        return None
    return " to ".join("any" if bound is None else f"{bound:g}" for bound in (low, high))


def absent(parameter: ActuatorFieldSpec) -> ScalarValue:
    """Return the value of a parameter that an actuator does not declare."""
    return False if parameter.kind == "bool" else 0.0


def mismatch(server: str, built_in: Mapping[str, ActuatorSpec], specs: Iterable[ActuatorSpec]) -> str | None:
    """Return the reason why the actuators of a program do not fit a server's commands, or None.

    Args:
        server: the server's name.
        built_in: the server's own actuators, by command.
        specs: the program's actuators, each of this server.
    """
    return next(_mismatches(server, built_in, specs), None)


def _mismatches(
    server: str, built_in: Mapping[str, ActuatorSpec], specs: Iterable[ActuatorSpec]
) -> Iterator[str]:
    names: dict[str, str] = {}
    for spec in specs:
        own = built_in.get(spec.command)
        if own is None:
            yield f"`{spec.name}`: {server} has no command `{spec.command}`"
            continue
        if spec.command in names:
            found = f"`{names[spec.command]}` and `{spec.name}` command {server}.{spec.command}"
            yield f"{found}; expected one actuator"
        names[spec.command] = spec.name
        yield from _mismatches_of(spec, own)


def _mismatches_of(spec: ActuatorSpec, own: ActuatorSpec) -> Iterator[str]:
    count, parameters = len(spec.fields), own.fields
    if len(spec.field_indices) != len(parameters):
        yield f"`{spec.name}`: {len(spec.field_indices)} parameters; expected {len(parameters)}"
        return
    indices = tuple(zip(parameters, spec.field_indices, strict=True))
    for parameter, index in indices:
        if index is None:
            continue
        if not 0 <= index < count:
            yield f"`{spec.name}`: `{parameter.name}` is not one of its {count} fields"
            return
        if (spec.fields[index].kind == "bool") != (parameter.kind == "bool"):
            yield f"`{spec.name}`: `{parameter.name}` is a {spec.fields[index].kind}"
    if any(not math.isfinite(field.factor) or field.factor == 0.0 for field in spec.fields):
        yield f"`{spec.name}`: a factor is 0 or not finite"
    if spec.idle is not None and len(spec.idle) != count:
        yield f"`{spec.name}`: an idle command of {len(spec.idle)} values, not {count}"
        return
    for parameter, index in indices:
        if index is not None and spec.idle is None:
            continue
        value = absent(parameter) if index is None or spec.idle is None else spec.idle[index]
        if (expected := expected_of(parameter, value)) is not None:
            yield f"`{spec.name}`: {parameter.name} = {value!r} when idle; expected {expected}"
    priorities = [priority for _, priority in spec.clients]
    if priorities != sorted(priorities, reverse=True):
        yield f"`{spec.name}`: the clients are not in the order of their priorities"


# --- commanding ----------------------------------------------------------------------------------------


Perform = Callable[[ActuatorSpec, tuple[ScalarValue, ...], int], None]
"""A function that carries out a command: the actuator, its fields in base units, the time.

It may raise `NotSentError`.
"""


class NotSentError(Exception):
    """A command that was not carried out; the message, for a verdict, says why.

    `instead` is what the actuator was given in its place, in base units; None if it was given nothing. It is
    the command itself, as far as it may be carried out, if `is_limited` is True.
    """

    def __init__(
        self, message: str, *, instead: tuple[ScalarValue, ...] | None = None, is_limited: bool = False
    ) -> None:
        super().__init__(message)
        self.instead, self.is_limited = instead, is_limited


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
        self._verdicts: dict[str, Verdict] = {}  # of the last frames
        self._refused: dict[str, int] = {}  # the last frames in which nothing of a command was carried out
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
        """Return what `reported` says of the frame before that of a tick, in base units.

        Nothing is returned for the fields of an actuator that was given nothing yet, for the roles of modules
        in a frame that was not decided here, nor for a tick that arrives after a later one: what was given
        last may have been given in a frame after it.
        """
        if tick.k < self._k:
            return {}
        return {
            reported_name(spec, of): Sample(value, tick.t_ns)
            for spec in self.actuators
            if spec.reported
            for of, value in self._before(spec, tick.previous)
        }

    def _before(self, spec: ActuatorSpec, k: int) -> Iterator[tuple[int | Role, ScalarValue]]:
        """Yield what is known of `reported` after frame `k`."""
        given, verdict = self._given.get(spec.name), self._verdicts.get(spec.name)
        fates = None if verdict is None or verdict.k != k else dict(verdict.fates[: len(spec.clients)])
        for of in spec.reported:
            if not isinstance(of, Role):
                if given is not None:
                    yield of, given[of]
            elif fates is not None:
                went_out = of.kind != "by" or self._refused.get(spec.name) != k
                yield of, went_out and had_role(fates, of)

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
                for note in self._send(spec, spec.idle, now_ns, self._k):
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
                    unsent += self._send(spec, event.values, now_ns, event.k)
            else:
                verdict, unsent = with_notes(event, unsent), []
                self._counts[name].add(verdict)
                self._verdicts[name] = verdict
                if self._publish:
                    yield SendMessage(topics.VERDICTS, verdict)
        for note in unsent:
            self.add_note(name, note)

    def _send(
        self, spec: ActuatorSpec, values: tuple[ScalarValue, ...], now_ns: int, k: int
    ) -> tuple[str, ...]:
        """Carry out a command in frame `k`; return notes for the verdict, why it was not carried out."""
        before, self._given[spec.name] = self._given.get(spec.name), values
        try:
            self._perform(spec, values, now_ns)
        except NotSentError as problem:
            given = before if problem.instead is None else problem.instead
            if given is None:
                self._given.pop(spec.name, None)
            else:
                self._given[spec.name] = given
            if not problem.is_limited:
                self._refused[spec.name] = k
            return (f"frame {self._k}: {problem}",)
        return ()

    def _schedule_wake(self, now_ns: int) -> Iterable[Effect]:
        times = (arbiter.wake_at for arbiter in self._arbiters.values())
        due = min((t_ns for t_ns in times if t_ns is not None), default=None)
        return self._wakes.request(due, now_ns)
