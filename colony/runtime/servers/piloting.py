"""Piloting of the base by connections outside a network: their motions, the lock, the emergency stop.

The pilot takes the calls of Table 4.1 that move the base, and returns the wanted commands of each frame
(`others`). Arbitration decides, and reports the result to the pilot (`dispatched`), so that only motions that
were carried out proceed. The pilot does not use a driver.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

from colony.runtime.arbitration import motion
from colony.runtime.arbitration.ballot import Others, Outside
from colony.runtime.arbitration.locks import LockQueue
from colony.runtime.arbitration.motion import Ending, Mode, Motion, Seen, Speeds, Step
from colony.runtime.arbitration.outside import Commander, Outsiders, lease_end
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.library import robot
from colony.runtime.protocol.calls import LATER, Asked, Later, Method, Nothing, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.servers import orders
from colony.runtime.servers.drivers import BaseLimits

Answer = tuple[Asked, float | RefusedError | None]
"""A call that was waiting, and its result or refusal."""


Bumper = Literal["front", "rear"]


class _Proposal(NamedTuple):
    commander: Commander
    step: Step
    speeds: Speeds


class Pilot:
    """The commands of outside connections. Mutable: the commanders, the lock, the settings, the mode.

    `allowed` and `places` (the clients of the network by priority) are those of the deployment. `answers` are
    the calls that came to an end; the owner of the pilot takes them from there.

    Args:
        limits: the limits of the base.
        emergency: the emergency stop of the base.
        values: converts speeds to values of the actuator.
        ticking: returns True if a Clock ticks at a time; without a Clock no frame carries out a command.
    """

    def __init__(
        self,
        limits: BaseLimits,
        emergency: StopFollower,
        values: Callable[[Speeds], tuple[float, ...]],
        ticking: Callable[[int], bool],
    ) -> None:
        self._emergency = emergency
        self._values = values
        self._ticking = ticking
        self._settings = orders.first_settings(limits)
        self._proposal: _Proposal | None = None
        self.outsiders = Outsiders()
        self.lock = LockQueue()
        self.allowed = orders.whole_range(limits)
        self.places: Mapping[int, str] = {}
        self.mode: Mode = "joystick"
        self.answers: list[Answer] = []
        self.changed = False
        """True if a command began or ended since this was last set to False."""

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods of the pilot."""
        return (
            method("drive", robot.Drive, self._drive),
            method("go", robot.Go, self._go),
            method("proportional_go", robot.Go, self._proportional_go),
            method("jog", robot.Jog, self._jog),
            method("stop", robot.Halt, self._halt),
            method("move", robot.Move, self._move),
            method("turn", robot.Turn, self._turn),
            method("continuous_turn", robot.ContinuousTurn, self._continuous_turn),
            method("mode", Nothing, lambda *_: self.mode, right="read"),
            method("lock", robot.LockBase, self._take_lock),
            method("unlock", Nothing, self._give_lock),
        )

    # --- frames --------------------------------------------------------------------------------------

    def others(self, seen: Seen, now_ns: int) -> Others:
        """Return the outside commands and holds of a frame, given the state of the base."""
        self._proposal = None
        if self._emergency.stopped is not None:
            return Others((), "stopped", None)
        self.outsiders.expire(now_ns)
        holder = self.lock.holder
        wanted: list[Outside] = []
        for commander in self.outsiders.commanding:
            caller = commander.caller
            values: tuple[float, ...] = ()
            if self._proposal is None and (holder is None or holder.connection == caller.connection):
                values = self._propose(commander, seen)
                if commander.motion is None:
                    continue
            wanted.append(Outside(caller.connection, caller.priority, values))
        if holder is None:
            return Others(tuple(wanted))
        return Others(tuple(wanted), "locked", holder.connection)

    def _propose(self, commander: Commander, seen: Seen) -> tuple[float, ...]:
        assert commander.motion is not None
        step = motion.step(commander.motion, seen)
        if step.end is not None:
            self._end(commander, step.end, seen)
            return ()
        speeds = self.allowed.clamp(step.speeds)
        self._proposal = _Proposal(commander, step, speeds)
        return self._values(speeds)

    def dispatched(self, outside: str | None) -> Speeds | None:
        """Note the connection that acts in the frame, None for none; return its speeds."""
        proposal, self._proposal = self._proposal, None
        if proposal is not None and proposal.commander.caller.connection != outside:
            proposal = None
        for commander in self.outsiders.commanding:
            if commander.motion is not None and (proposal is None or commander is not proposal.commander):
                commander.motion = motion.interrupted(commander.motion)
        if proposal is None:
            return None
        proposal.commander.motion = proposal.step.motion
        self.mode = motion.mode(proposal.step.motion)
        return proposal.speeds

    def drove(self, network: bool) -> None:
        """Note that the network acted in a frame, or no client: a motion with an end is over."""
        if network:
            self.mode = "jog"
        elif self.mode in ("continuous turn", "point-to-point go", "point-to-point turn"):
            self.mode = "go"

    def bumped(self, connection: str, bumper: Bumper, seen: Seen) -> None:
        """End the motion of a connection that a bumper stopped, if it is a move or an arc."""
        for commander in self.outsiders.commanding:
            moving = isinstance(commander.motion, motion.Move | motion.Arc)
            if moving and commander.caller.connection == connection:
                self._end(commander, bumper, seen)

    def _end(
        self, commander: Commander, why: Literal["done", "stalled", "front", "rear"], seen: Seen
    ) -> None:
        ended, asked = commander.motion, commander.asked
        commander.motion = commander.asked = commander.until_ns = None
        self.mode = "go"
        if asked is None or not isinstance(ended, Ending):
            return
        unit = "mm" if isinstance(ended, motion.Move) else "deg"
        done = motion.covered(ended, seen.track)
        match why:
            case "done":
                self.answers.append((asked, done))
            case "stalled":
                stalled = f"no progress for {motion.STALLED_S:g} s, after {done:.4g} {unit}"
                self.answers.append((asked, RefusedError("stalled", stalled)))
            case "front" | "rear":
                bumped = f"the {why} bumper is pressed, after {done:.4g} {unit}"
                self.answers.append((asked, RefusedError("bumper", bumped)))

    def report(self, now_ns: int) -> tuple[robot.OutsideReport, ...]:
        """Return the connections that have commanded, and their present commands."""
        return tuple(
            robot.OutsideReport(
                connection=commander.caller.connection,
                name=commander.caller.name,
                priority=commander.caller.priority,
                commands=None if commander.motion is None else motion.mode(commander.motion),
                lease_s=None if commander.until_ns is None else (commander.until_ns - now_ns) / 1e9,
            )
            for commander in self.outsiders.all
        )

    # --- ends of commands from outside ---------------------------------------------------------------

    def cancel(self, refused: RefusedError, spared: str | None = None) -> None:
        """End every command, except that of one connection."""
        for commander in self.outsiders.all:
            if commander.caller.connection != spared:
                self._drop(commander, refused)

    def stop(self) -> None:
        """End all commands, as the emergency stop has come on."""
        self.cancel(self._stopped())
        self.mode = "joystick"
        self.changed = True

    def lost(self, caller: Caller) -> None:
        """Remove a connection that ended, with its command and its lock."""
        commander = self.outsiders.of(caller)
        self.changed = self.changed or (commander is not None and commander.motion is not None)
        self.outsiders.leave(caller)
        self._granted(self.lock.drop(caller))

    def expire(self, now_ns: int) -> None:
        """Refuse calls whose wait for the lock timed out."""
        for asked in self.lock.expire(now_ns):
            self.answers.append((asked, self.lock.refusal()))

    def _drop(self, commander: Commander, refused: RefusedError) -> None:
        if commander.asked is not None:
            self.answers.append((commander.asked, refused))
        commander.motion = commander.asked = commander.until_ns = None

    def _stopped(self) -> RefusedError:
        stopped = self._emergency.stopped
        by = "" if stopped is None else f", by {stopped.by}"
        return RefusedError(
            "stopped", f"the emergency stop is on{by}; the Clock releases it (`colony stop --release`)"
        )

    # --- calls ---------------------------------------------------------------------------------------

    def _admit(self, caller: Caller) -> Commander:
        if self._emergency.stopped is not None:
            raise self._stopped()
        holder = self.lock.holder
        if holder is not None and holder.connection != caller.connection:
            raise self.lock.refusal()
        return self.outsiders.enter(caller, self.places)

    def _admit_motion(self, caller: Caller, now_ns: int) -> Commander:
        if not self._ticking(now_ns):
            raise RefusedError(
                "clock", "no Clock ticks, so that nothing would move the base (see `colony ps`)"
            )
        return self._admit(caller)

    def _hold(self, commander: Commander, wanted: Motion, until_ns: int) -> None:
        """Set a command that holds for a lease."""
        self._drop(commander, _REPLACED)
        commander.motion, commander.until_ns = wanted, until_ns
        self.changed = True

    def _begin(self, asked: Asked, wanted: Ending, wait: bool, now_ns: int) -> Later | None:
        """Set a command that holds until it is done."""
        commander = self._admit_motion(asked.caller, now_ns)
        self._drop(commander, _REPLACED)
        commander.motion = wanted
        self.changed = True
        if not wait:
            return None
        commander.asked = asked
        return LATER

    def _drive(self, asked: Asked, arguments: robot.Drive, now_ns: int) -> None:
        wanted, until_ns = orders.drive(arguments, self.allowed), lease_end(arguments.lease_s, now_ns)
        self._hold(self._admit_motion(asked.caller, now_ns), wanted, until_ns)

    def _go(self, asked: Asked, arguments: robot.Go, now_ns: int, integrating: bool = True) -> None:
        before, until_ns = self._before(asked.caller), lease_end(arguments.lease_s, now_ns)
        wanted, settings = orders.go(arguments, self._settings, self.allowed, before, integrating=integrating)
        self._hold(self._admit_motion(asked.caller, now_ns), wanted, until_ns)
        self._settings = settings

    def _proportional_go(self, asked: Asked, arguments: robot.Go, now_ns: int) -> None:
        self._go(asked, arguments, now_ns, integrating=False)

    def _jog(self, asked: Asked, arguments: robot.Jog, now_ns: int) -> None:
        before, until_ns = self._before(asked.caller), lease_end(arguments.lease_s, now_ns)
        wanted = orders.jog(arguments, self._settings, self.allowed, before)
        self._hold(self._admit_motion(asked.caller, now_ns), wanted, until_ns)

    def _halt(self, asked: Asked, arguments: robot.Halt, now_ns: int) -> None:
        until_ns = lease_end(arguments.lease_s, now_ns)
        self._hold(self._admit(asked.caller), orders.halt(arguments, self._settings), until_ns)

    def _move(self, asked: Asked, arguments: robot.Move, now_ns: int) -> Later | None:
        wanted, settings = orders.move(arguments, self._settings, self.allowed)
        answer = self._begin(asked, wanted, arguments.wait, now_ns)
        self._settings = settings
        return answer

    def _turn(self, asked: Asked, arguments: robot.Turn, now_ns: int) -> Later | None:
        wanted, settings = orders.turn(arguments, self._settings, self.allowed)
        answer = self._begin(asked, wanted, arguments.wait, now_ns)
        self._settings = settings
        return answer

    def _continuous_turn(self, asked: Asked, arguments: robot.ContinuousTurn, now_ns: int) -> Later | None:
        wanted, settings = orders.continuous_turn(arguments, self._settings, self.allowed)
        answer = self._begin(asked, wanted, arguments.wait, now_ns)
        self._settings = settings
        return answer

    def _before(self, caller: Caller) -> Motion | None:
        commander = self.outsiders.of(caller)
        return None if commander is None else commander.motion

    # --- lock ----------------------------------------------------------------------------------------

    def _take_lock(self, asked: Asked, arguments: robot.LockBase, now_ns: int) -> Later | None:
        if self._emergency.stopped is not None:
            raise self._stopped()
        self.outsiders.enter(asked.caller, self.places)
        if not self.lock.ask(asked, now_ns, wait_ns=arguments.wait_ns):
            return LATER
        self._locked()
        return None

    def _give_lock(self, asked: Asked, arguments: Nothing, now_ns: int) -> None:
        self._granted(self.lock.release(asked.caller))
        self.changed = True

    def _granted(self, granted: tuple[Asked, ...]) -> None:
        if granted:
            self.answers += [(asked, None) for asked in granted]
            self._locked()

    def _locked(self) -> None:
        holder = self.lock.holder
        assert holder is not None
        self.cancel(self.lock.refusal(), spared=holder.connection)
        self.changed = True


_REPLACED = RefusedError("replaced", "this connection commanded something else")
