"""Control of actuators by connections outside the network: who may command, until when, and the lock.

RServer's motions (`piloting.py`) and the values that all other servers take (`OutsideCommands`) are under
the same rules, and these are here: priorities without ties, leases, the lock, the emergency stop, the end of
a connection, and the end of a run whose limits held its command. A connection's priority and lease are those
of one actuator; the lock is that of the server.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, NamedTuple, TypeVar

from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import Dispatch
from colony.runtime.arbitration.ballot import NO_INTERVENTIONS, STOPPED, Interventions, OutsideCommand
from colony.runtime.arbitration.outside import Commander, LockQueue, OutsideCommanders, lease_end
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.library import actuator
from colony.runtime.protocol.calls import LATER, CallId, Later, Method, NoArguments, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec
from colony.runtime.servers.commanding import absent, expected_of

# --- outside control -----------------------------------------------------------------------------------


CLOCK_GRACE_NS = 2_000_000_000
"""Nanoseconds without a tick after which calls that command an actuator are refused."""

STALE_FRAMES = 2
"""Age in frames above which a tick is too old to move anything.

Then the process was suspended, and may not have received a later emergency stop yet.
"""

FRAME_NS = 50_000_000
"""Frame period of a robot without a program, in nanoseconds."""

Frames = Literal["program", "free", "other"]
"""The run of the newest frame: the deployed program's, none while no program is led, or any other."""

Answer = tuple[CallId, float | RefusedError | None]
"""A call that waited, and its result or refusal."""

C = TypeVar("C")


@dataclass(frozen=False, slots=True, kw_only=True)
class ActuatorState:
    """The actuators of a server, its emergency stop, and the newest frame. Mutable.

    Attributes:
        server: the server's name.
        built_in: the server's own actuators, which are commanded while no program has one, by command.
        emergency: the emergency stop of the server.
        bound: the actuators of the deployed program, by command.
        run: the deployed run, None without one.
        frame_ns: frame period of the run.
        lockstep: True if each frame of the run begins when the one before is decided.
        frames: the kind of the newest frame.
        k: the number of the newest frame.
        tick_ns: the time of its tick, and of the start before the first one.
    """

    server: str
    built_in: Mapping[str, ActuatorSpec]
    emergency: StopFollower = field(default_factory=StopFollower)
    bound: Mapping[str, ActuatorSpec] = field(default_factory=dict)
    run: str | None = None
    frame_ns: int = FRAME_NS
    lockstep: bool = False
    frames: Frames = "other"
    k: int = -1
    tick_ns: int = 0

    @property
    def actuators(self) -> Mapping[str, ActuatorSpec]:
        """The actuators that connections may command, by command."""
        return {**self.built_in, **self.bound}

    def is_ticking(self, now_ns: int) -> bool:
        """Return True if the Clock ticked recently; always in lockstep, where ticks only count frames."""
        return self.lockstep or now_ns - self.tick_ns <= CLOCK_GRACE_NS

    def is_stale(self, now_ns: int) -> bool:
        """Return True if the newest frame is long over; never in lockstep, where ticks only count frames."""
        return not self.lockstep and now_ns - self.tick_ns > STALE_FRAMES * self.frame_ns


class Contest(NamedTuple, Generic[C]):
    """The parties that compete for one actuator: the connections, and the network's clients by priority."""

    commanders: OutsideCommanders[C]
    clients: Mapping[int, str]


class Proposal(NamedTuple):
    """What a connection commands in a frame: values in base units, and what they were derived from."""

    values: tuple[ScalarValue, ...]
    source: object = None


class OutsideControl(ABC, Generic[C]):
    """The connections that command a server's actuators, and the server's lock. Mutable.

    `answers` are the results of calls that have ended; the owner empties the list. `changed` is True if a
    command began or ended; the owner sets it to False.

    Args:
        state: the server's actuators, which the owner keeps up to date.
    """

    def __init__(self, state: ActuatorState) -> None:
        self.state = state
        self.lock = LockQueue()
        self.answers: list[Answer] = []
        self.changed = False
        self._commanders: dict[str, OutsideCommanders[C]] = {}

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods that every server with actuators has."""
        return (
            method("give_way", NoArguments, self._give_way),
            method("ignore_limits", actuator.IgnoreLimits, self._ignore_limits, right="unlimited"),
            method("lock", actuator.Lock, self._acquire_lock),
            method("unlock", NoArguments, self._release_lock),
        )

    def contest(self, spec: ActuatorSpec) -> Contest[C]:
        """Return the parties that compete for an actuator."""
        commanders = self._commanders.setdefault(spec.command, OutsideCommanders())
        return Contest(commanders, {priority: client for client, priority in spec.clients})

    def find_tie(self, specs: Iterable[ActuatorSpec]) -> str | None:
        """Return a conflict between the priorities of a program and those of connections, or None."""
        contests = map(self.contest, specs)
        ties = (contest.commanders.find_tie(contest.clients) for contest in contests)
        return next((tie for tie in ties if tie is not None), None)

    # --- frames --------------------------------------------------------------------------------------

    def interventions(self, spec: ActuatorSpec, now_ns: int) -> Interventions:
        """Return the outside commands for an actuator in a frame, and the stop or lock in force."""
        if self.state.emergency.stopped is not None:
            return STOPPED
        holder, commanders = self.lock.holder, self._commanders.get(spec.command)
        commanding: tuple[Commander[C], ...] = ()
        if commanders is not None:
            commanders.expire(now_ns)
            commanding = commanders.commanding
        commands: list[OutsideCommand] = []
        is_free = True
        for commander in commanding:
            caller = commander.caller
            may_act = is_free and (holder is None or holder.connection == caller.connection)
            proposal = self._propose(spec, commander, may_act, now_ns)
            if proposal is None:
                continue
            is_free = is_free and not may_act
            values, source = proposal
            commands.append(
                OutsideCommand(caller.connection, caller.priority, values, commander.unlimited, source)
            )
        if holder is not None:
            return Interventions(tuple(commands), "locked", holder.connection)
        return Interventions(tuple(commands)) if commands else NO_INTERVENTIONS

    @abstractmethod
    def _propose(
        self, spec: ActuatorSpec, commander: Commander[C], may_act: bool, now_ns: int
    ) -> Proposal | None:
        """Return what a connection commands in a frame; None if its command has ended.

        The values matter only if it `may_act`: no connection above it commands, and none locks it out.
        """

    def on_dispatch(self, spec: ActuatorSpec, dispatch: Dispatch, now_ns: int) -> None:
        """Handle the dispatch of a frame, before it is carried out."""

    @abstractmethod
    def report(self, now_ns: int) -> tuple[Any, ...]:
        """Return the connections that have commanded, and their current commands."""

    def _reported(self, now_ns: int) -> Iterator[tuple[str, C | None, dict[str, Any]]]:
        """Yield each connection's command of an actuator, and what the reports of all servers have."""
        for name, commanders in self._commanders.items():
            for commander in commanders.all:
                caller, end_ns = commander.caller, commander.lease_end_ns
                common = {
                    "connection": caller.connection,
                    "name": caller.name,
                    "priority": caller.priority,
                    "lease_s": None if end_ns is None else (end_ns - now_ns) / 1e9,
                    "unlimited": commander.unlimited,
                }
                yield name, commander.command, common

    # --- beginnings of commands ----------------------------------------------------------------------

    def admit(self, caller: Caller, contest: Contest[C]) -> Commander[C]:
        """Return the commander of a connection that may command now.

        Raises:
            RefusedError: "stopped", "locked", or "tie": its priority is taken.
        """
        if self.state.emergency.stopped is not None:
            raise self.stop_refusal()
        holder = self.lock.holder
        if holder is not None and holder.connection != caller.connection:
            raise self.lock.refusal()
        return contest.commanders.enter(caller, contest.clients)

    def admit_while_ticking(self, caller: Caller, contest: Contest[C], now_ns: int) -> Commander[C]:
        """Return the commander of a connection whose command needs frames to be carried out.

        Raises:
            RefusedError: as by `admit`, and "clock": no frames begin.
        """
        if not self.state.is_ticking(now_ns):
            raise RefusedError(
                "clock",
                f"no tick of the Clock reaches {self.state.server}, so nothing moves (see `colony ps`)",
            )
        return self.admit(caller, contest)

    def begin(
        self,
        commander: Commander[C],
        command: C,
        *,
        lease_end_ns: int | None = None,
        call_id: CallId | None = None,
    ) -> None:
        """Replace the command of a connection; `call_id` is the call that is answered at its end."""
        self._cancel(commander, _REPLACED)
        commander.command, commander.lease_end_ns, commander.call_id = command, lease_end_ns, call_id
        self.changed = True

    # --- ends of commands ----------------------------------------------------------------------------

    def cancel(self, refused: RefusedError, except_connection: str | None = None) -> None:
        """Cancel all commands, except those of one connection."""
        for contest in self._contests():
            for commander in contest.commanders.all:
                if commander.caller.connection != except_connection:
                    self._cancel(commander, refused)

    def end_limited(self) -> None:
        """Cancel the commands that the limits of the program held, because its run ends."""
        refused = RefusedError("limits", "the run whose limits held this command ended")
        for spec in self.state.bound.values():
            if spec.limited:
                for commander in self.contest(spec).commanders.all:
                    if not commander.unlimited:
                        self._cancel(commander, refused)
                self.changed = True

    def stop(self) -> None:
        """Cancel all commands because of the emergency stop."""
        self.cancel(self.stop_refusal())
        self.changed = True

    def on_lost(self, caller: Caller) -> None:
        """Remove a connection that ended, with its commands and its lock."""
        for contest in self._contests():
            commander = contest.commanders.find(caller)
            self.changed = self.changed or (commander is not None and commander.command is not None)
            contest.commanders.leave(caller)
        self._on_grant(self.lock.drop(caller))

    def expire(self, now_ns: int) -> None:
        """Refuse calls whose wait for the lock timed out."""
        for call_id in self.lock.expire(now_ns):
            self.answers.append((call_id, self.lock.refusal()))

    def stop_refusal(self) -> RefusedError:
        """Return the refusal of a command during the emergency stop."""
        stopped = self.state.emergency.stopped
        by = "" if stopped is None else f", by {stopped.by}"
        return RefusedError(
            "stopped", f"the emergency stop is on{by}; the Clock releases it (`colony stop --release`)"
        )

    def _cancel(self, commander: Commander[C], refused: RefusedError) -> None:
        if commander.call_id is not None:
            self.answers.append((commander.call_id, refused))
        commander.end()

    def _contests(self) -> Iterable[Contest[C]]:
        """Return the contests of all actuators, and of those that connections commanded in earlier runs."""
        now = {command: self.contest(spec) for command, spec in self.state.actuators.items()}
        before = {name: Contest[C](c, {}) for name, c in self._commanders.items() if name not in now}
        return (*now.values(), *before.values())

    # --- calls ---------------------------------------------------------------------------------------

    def _give_way(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> None:
        for contest in self._contests():
            if (commander := contest.commanders.find(call_id.caller)) is not None:
                self._cancel(commander, _GAVE_WAY)
                self.changed = True

    def _ignore_limits(self, call_id: CallId, arguments: actuator.IgnoreLimits, now_ns: int) -> None:
        entered = [c.commanders.enter(call_id.caller, c.clients) for c in self._contests()]
        for commander in entered:
            commander.unlimited = arguments.ignoring
        self.changed = True

    def _acquire_lock(self, call_id: CallId, arguments: actuator.Lock, now_ns: int) -> Later | None:
        if self.state.emergency.stopped is not None:
            raise self.stop_refusal()
        for contest in self._contests():
            contest.commanders.enter(call_id.caller, contest.clients)
        if not self.lock.acquire(call_id, now_ns, wait_ns=arguments.wait_ns):
            return LATER
        self._on_lock()
        return None

    def _release_lock(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> None:
        self._on_grant(self.lock.release(call_id.caller))
        self.changed = True

    def _on_grant(self, granted: tuple[CallId, ...]) -> None:
        if granted:
            self.answers += [(call_id, None) for call_id in granted]
            self._on_lock()

    def _on_lock(self) -> None:
        holder = self.lock.holder
        assert holder is not None
        self.cancel(self.lock.refusal(), except_connection=holder.connection)
        self.changed = True


_REPLACED = RefusedError("replaced", "this connection commanded something else")
_GAVE_WAY = RefusedError("replaced", "this connection gave way")


# --- outside commands ----------------------------------------------------------------------------------
#
# Commands of connections to the actuators of a server that has no motions of its own.
#
# A connection commands by the name of the server's command, with the values of its parameters. In frames of
# a program, these are values of the actuator that the program binds to that command; without one, of the
# server's built-in actuator.


Given = Mapping[str, ScalarValue]
"""The values of a command's parameters, in base units."""

Indices = Mapping[str, int | None]
"""The index of the actuator's field for each parameter of a command; None for no field."""


class OutsideCommands(OutsideControl[Given]):
    """The commands of connections to a server's actuators. Mutable."""

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods that command, and those of every server with actuators."""
        return (method("command", actuator.CommandArguments, self._command), *super().methods)

    def report(self, now_ns: int) -> tuple[actuator.OutsideReport, ...]:
        """Return the connections that have commanded, and their current commands."""
        return tuple(
            actuator.OutsideReport(command=name, values=None if given is None else dict(given), **common)
            for name, given, common in self._reported(now_ns)
        )

    def _propose(
        self, spec: ActuatorSpec, commander: Commander[Given], may_act: bool, now_ns: int
    ) -> Proposal | None:
        assert commander.command is not None
        values = fitted(spec, self._indices(spec), commander.command)
        if values is None:  # another program runs, whose actuator does not take this command
            commander.end()
            return None
        return Proposal(values)

    def _indices(self, spec: ActuatorSpec) -> Indices:
        built_in = self.state.built_in.get(spec.command)
        if built_in is None:
            return {field.name: i for i, field in enumerate(spec.fields)}
        names = (field.name for field in built_in.fields)
        return dict(zip(names, spec.field_indices, strict=True))

    def _command(self, call_id: CallId, arguments: actuator.CommandArguments, now_ns: int) -> None:
        server, actuators = self.state.server, self.state.actuators
        spec = actuators.get(arguments.command)
        if spec is None:
            found = f"{server} has no command `{arguments.command}`"
            expected = f"it has {', '.join(actuators)}" if actuators else "it has none now"
            raise RefusedError("arguments", f"{found}; {expected}")
        problem = mismatch(spec, self._indices(spec), arguments.values)
        if problem is not None:
            raise RefusedError("arguments", f"{server}.{arguments.command}: {problem}")
        lease_end_ns = lease_end(arguments.lease_s, now_ns)
        commander = self.admit_while_ticking(call_id.caller, self.contest(spec), now_ns)
        self.begin(commander, arguments.values, lease_end_ns=lease_end_ns)


# --- values ----------------------------------------------------------------------------------------


def mismatch(spec: ActuatorSpec, indices: Indices, given: Given) -> str | None:
    """Return the reason why these values are no command of an actuator, or None if they are one."""
    for name in given:
        if name not in indices:
            return f"found `{name}`; its parameters are {', '.join(indices)}"
    for name, index in indices.items():
        value = given.get(name)
        if index is None:
            if value:
                return f"{name} = {value!r}, but the actuator `{spec.name}` has no such field"
        elif value is None:
            return f"{name} is missing"
        elif (expected := expected_of(spec.fields[index], value)) is not None:
            return f"{name} = {value!r}; expected {expected}"
    return None


def fitted(spec: ActuatorSpec, indices: Indices, given: Given) -> tuple[ScalarValue, ...] | None:
    """Return the values of an actuator's fields, within their ranges; None if they are not of its kinds."""
    values = [absent(field) for field in spec.fields]
    for name, index in indices.items():
        value = given.get(name)
        if index is None:
            if value:
                return None
            continue
        field = spec.fields[index]
        if field.kind == "number" and value is not None and not isinstance(value, bool):
            value = _within(field, float(value))
        if value is None or expected_of(field, value) is not None:
            return None
        values[index] = value
    return tuple(values)


def _within(field: ActuatorFieldSpec, value: float) -> float:
    if field.low is not None and value < field.low:
        return field.low
    return field.high if field.high is not None and value > field.high else value
