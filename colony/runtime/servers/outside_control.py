"""Control of actuators by connections outside the network: who may command, until when, and the lock.

RServer's motions (`piloting.py`) and the commands of all other servers (`outside_commands.py`) are under the
same rules, and these are here: priorities without ties, leases, the lock, the emergency stop, the end of a
connection, and the end of a run whose limits held its command.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Generic, NamedTuple, TypeVar

from colony.runtime.arbitration.locks import LockQueue
from colony.runtime.arbitration.outside import Commander, OutsideCommanders
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.library import actuator
from colony.runtime.protocol.calls import LATER, CallId, Later, Method, NoArguments, RefusedError, method
from colony.runtime.protocol.connections import Caller

CLOCK_GRACE_NS = 2_000_000_000
"""Nanoseconds without a tick after which calls that command an actuator are refused."""

Answer = tuple[CallId, float | RefusedError | None]
"""A call that waited, and its result or refusal."""

C = TypeVar("C")


class Contest(NamedTuple, Generic[C]):
    """The parties that compete for one actuator: the connections, and the network's clients by priority."""

    commanders: OutsideCommanders[C]
    clients: Mapping[int, str]


class OutsideControl(Generic[C]):
    """The connections that command a server's actuators, and the server's lock. Mutable.

    `answers` are the results of calls that have ended; the owner empties the list. `changed` is True if a
    command began or ended; the owner sets it to False.

    Args:
        contests: function that returns the parties that compete for each of the server's actuators.
        emergency: the emergency stop of the server.
        is_ticking: function that returns True if the Clock is ticking at a given time; otherwise, commands
            are refused.
        server: name of the server, for messages.
    """

    def __init__(
        self,
        contests: Callable[[], Iterable[Contest[C]]],
        emergency: StopFollower,
        is_ticking: Callable[[int], bool],
        server: str,
    ) -> None:
        self._contests = contests
        self._emergency = emergency
        self._is_ticking = is_ticking
        self._server = server
        self.lock = LockQueue()
        self.answers: list[Answer] = []
        self.changed = False

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods that every server with actuators has."""
        return (
            method("ignore_limits", actuator.IgnoreLimits, self._ignore_limits, right="unlimited"),
            method("lock", actuator.Lock, self._acquire_lock),
            method("unlock", NoArguments, self._release_lock),
        )

    # --- beginnings of commands ----------------------------------------------------------------------

    def admit(self, caller: Caller, contest: Contest[C]) -> Commander[C]:
        """Return the commander of a connection that may command now.

        Raises:
            RefusedError: "stopped", "locked", or "tie": its priority is taken.
        """
        if self._emergency.stopped is not None:
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
        if not self._is_ticking(now_ns):
            raise RefusedError(
                "clock", f"no tick of the Clock reaches {self._server}, so nothing moves (see `colony ps`)"
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

    def end_limited(self, contest: Contest[C]) -> None:
        """Cancel the commands that the limits of a program held, because its run ended."""
        refused = RefusedError("limits", "the run whose limits held this command ended")
        for commander in contest.commanders.all:
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
        stopped = self._emergency.stopped
        by = "" if stopped is None else f", by {stopped.by}"
        return RefusedError(
            "stopped", f"the emergency stop is on{by}; the Clock releases it (`colony stop --release`)"
        )

    def _cancel(self, commander: Commander[C], refused: RefusedError) -> None:
        if commander.call_id is not None:
            self.answers.append((commander.call_id, refused))
        commander.end()

    # --- calls ---------------------------------------------------------------------------------------

    def _ignore_limits(self, call_id: CallId, arguments: actuator.IgnoreLimits, now_ns: int) -> None:
        entered = [c.commanders.enter(call_id.caller, c.clients) for c in self._contests()]
        for commander in entered:
            commander.unlimited = arguments.ignoring
        self.changed = True

    def _acquire_lock(self, call_id: CallId, arguments: actuator.Lock, now_ns: int) -> Later | None:
        if self._emergency.stopped is not None:
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
