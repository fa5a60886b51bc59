"""Control of the base by connections outside the network: their motions.

The pilot handles the calls of Table 4.1 that move the base, under the rules of `outside_control.py`. For each
frame, it returns the commands that connections request (`interventions`). Arbitration decides, and reports
the result to the pilot (`on_dispatch`), so that only the motion that was carried out progresses. The pilot
does not use a driver.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

from colony.ir.servers import RSERVER
from colony.runtime.arbitration import motion
from colony.runtime.arbitration.ballot import Interventions, OutsideCommand
from colony.runtime.arbitration.frame_bounds import LIMITS_UNKNOWN
from colony.runtime.arbitration.motion import BaseObservation, FiniteMotion, Mode, Motion, Speeds, Step
from colony.runtime.arbitration.outside import Commander, OutsideCommanders, lease_end
from colony.runtime.arbitration.stop_latch import StopFollower
from colony.runtime.library import robot
from colony.runtime.protocol.calls import LATER, CallId, Later, Method, NoArguments, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.servers import motion_commands
from colony.runtime.servers.drivers import BaseLimits
from colony.runtime.servers.outside_control import Contest, OutsideControl

Bumper = Literal["front", "rear"]


class _Proposal(NamedTuple):
    commander: Commander[Motion]
    step: Step
    speeds: Speeds


class Pilot(OutsideControl[Motion]):
    """The motions of outside connections. Mutable.

    `allowed` (the range) and `clients` (the clients of the network by priority) are those of the deployment.
    `stops_immediately` is True if the connection that acts stops the base by its emergency stop.

    Args:
        limits: the limits of the base.
        emergency: the emergency stop of the base.
        values: converts speeds to values of the actuator.
        is_ticking: function that returns True if the Clock is ticking at a given time; otherwise, motions are
            refused.
        require_state: raises RefusedError if the base does not report a state; motions are refused then.
    """

    def __init__(
        self,
        limits: BaseLimits,
        emergency: StopFollower,
        values: Callable[[Speeds], tuple[float, ...]],
        is_ticking: Callable[[int], bool],
        require_state: Callable[[], object],
    ) -> None:
        super().__init__(lambda: (self._contest,), emergency, is_ticking, RSERVER.name)
        self._values = values
        self._require_state = require_state
        self._settings = motion_commands.initial_settings(limits)
        self._proposal: _Proposal | None = None
        self.outside_commanders = OutsideCommanders[Motion]()
        self.allowed = motion_commands.full_range(limits)
        self.clients: Mapping[int, str] = {}
        self.mode: Mode = "joystick"
        self.stops_immediately = False

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods of the pilot."""
        ignore_limits, lock, unlock = super().methods
        return (
            method("drive", robot.Drive, self._drive),
            method("go", robot.Go, self._go),
            method("proportional_go", robot.Go, self._proportional_go),
            method("jog", robot.Jog, self._jog),
            method("stop", robot.Halt, self._halt),
            method("move", robot.Move, self._move),
            method("turn", robot.Turn, self._turn),
            method("continuous_turn", robot.ContinuousTurn, self._continuous_turn),
            method("mode", NoArguments, lambda *_: self.mode, right="read"),
            ignore_limits,
            lock,
            unlock,
        )

    @property
    def _contest(self) -> Contest[Motion]:
        return Contest(self.outside_commanders, self.clients)

    # --- frames --------------------------------------------------------------------------------------

    def interventions(self, observation: BaseObservation, now_ns: int) -> Interventions:
        """Return the outside commands of a frame, and the stop or lock in force, given the base's state."""
        self._proposal = None
        if self._emergency.stopped is not None:
            return Interventions((), "stopped", None)
        self.outside_commanders.expire(now_ns)
        holder = self.lock.holder
        commands: list[OutsideCommand] = []
        for commander in self.outside_commanders.commanding:
            caller = commander.caller
            values: tuple[float, ...] = ()
            if self._proposal is None and (holder is None or holder.connection == caller.connection):
                values = self._propose(commander, observation, now_ns)
                if commander.command is None:
                    continue
            commands.append(
                OutsideCommand(caller.connection, caller.priority, values, unlimited=commander.unlimited)
            )
        if holder is None:
            return Interventions(tuple(commands))
        return Interventions(tuple(commands), "locked", holder.connection)

    def _propose(
        self, commander: Commander[Motion], observation: BaseObservation, now_ns: int
    ) -> tuple[float, ...]:
        assert commander.command is not None
        step = motion.step(commander.command, observation)
        held_since_ns = commander.held_since_ns
        if held_since_ns is not None and now_ns - held_since_ns > motion.STALL_TIMEOUT_S * 1e9:
            step = step._replace(end=step.end or "stalled")
        if step.end is not None:
            self._end(commander, step.end, observation)
            return ()
        speeds = self.allowed.clamp(step.speeds)
        self._proposal = _Proposal(commander, step, speeds)
        return self._values(speeds)

    def on_dispatch(
        self,
        outside: str | None,
        now_ns: int = 0,
        bound: Callable[[Speeds], Speeds | None] = lambda proposed: proposed,
        fault: str | None = None,
    ) -> Speeds | None:
        """Advance the motion of the connection that acts in the frame, if any, and return its speeds.

        Args:
            outside: connection that acts.
            now_ns: present time.
            bound: returns the speeds that were sent, given the proposed ones; None if the actuator was idle
                in the place of its command.
            fault: reason why the actuator was idle in its place.
        """
        proposal, self._proposal = self._proposal, None
        self.stops_immediately = False
        if proposal is not None and proposal.commander.caller.connection != outside:
            proposal = None
        for commander in self.outside_commanders.commanding:
            if commander.command is not None and (proposal is None or commander is not proposal.commander):
                commander.command = motion.interrupt(commander.command)
        if proposal is None:
            return None
        commander, sent = proposal.commander, bound(proposal.speeds)
        commander.command = proposal.step.motion if sent else motion.interrupt(proposal.step.motion)
        commander.fault = fault
        commander.held_at_rest = motion.is_held_at_rest(proposal.step.motion, proposal.speeds, sent)
        if not (commander.held_at_rest and motion.is_stalling(proposal.step.motion)):
            commander.held_since_ns = None
        elif commander.held_since_ns is None:
            commander.held_since_ns = now_ns
        self.mode = motion.mode(proposal.step.motion)
        self.stops_immediately = motion.is_immediate_halt(proposal.step.motion)
        return sent

    def on_network_dispatch(self, active: bool) -> None:
        """Set the mode for a frame without an outside command; `active` is True if a client won."""
        if active:
            self.mode = "jog"
        elif self.mode in ("continuous turn", "point-to-point go", "point-to-point turn"):
            self.mode = "go"

    def on_bumper(self, connection: str, bumper: Bumper, observation: BaseObservation) -> None:
        """End the move or arc of a connection, because a bumper stopped it."""
        for commander in self.outside_commanders.commanding:
            moving = isinstance(commander.command, motion.Move | motion.Arc)
            if moving and commander.caller.connection == connection:
                self._end(commander, bumper, observation)

    def _end(
        self,
        commander: Commander[Motion],
        reason: Literal["done", "stalled", "front", "rear"],
        observation: BaseObservation,
    ) -> None:
        ended, call_id = commander.command, commander.call_id
        commander.end()
        self.mode = "go"
        if call_id is None or not isinstance(ended, FiniteMotion):
            return
        unit = "mm" if isinstance(ended, motion.Move) else "deg"
        progress = motion.measure_progress(ended, observation.pose)
        match reason:
            case "done":
                self.answers.append((call_id, progress))
            case "stalled":
                self.answers.append((call_id, _stalled(f"{progress:.4g} {unit}", commander)))
            case "front" | "rear":
                text = f"the {reason} bumper is pressed, after {progress:.4g} {unit}"
                self.answers.append((call_id, RefusedError("bumper", text)))

    def report(self, now_ns: int) -> tuple[robot.OutsideReport, ...]:
        """Return the connections that have commanded, and their current commands."""
        return tuple(
            robot.OutsideReport(
                connection=commander.caller.connection,
                name=commander.caller.name,
                priority=commander.caller.priority,
                commands=None if commander.command is None else motion.call_of(commander.command),
                lease_s=None if commander.lease_end_ns is None else (commander.lease_end_ns - now_ns) / 1e9,
                unlimited=commander.unlimited,
            )
            for commander in self.outside_commanders.all
        )

    def on_limits_end(self) -> None:
        """Cancel the commands that the limits of a program held, because its run ended."""
        self.end_limited(self._contest)

    def stop(self) -> None:
        """Cancel all commands because of the emergency stop."""
        super().stop()
        self.mode = "joystick"

    # --- calls ---------------------------------------------------------------------------------------

    def _admit_motion(self, caller: Caller, now_ns: int) -> Commander[Motion]:
        commander = self.admit_while_ticking(caller, self._contest, now_ns)
        self._require_state()
        return commander

    def _set_motion(self, call_id: CallId, new_motion: FiniteMotion, wait: bool, now_ns: int) -> Later | None:
        """Set a command that stays in force until it is done."""
        commander = self._admit_motion(call_id.caller, now_ns)
        self.begin(commander, new_motion, call_id=call_id if wait else None)
        return LATER if wait else None

    def _drive(self, call_id: CallId, arguments: robot.Drive, now_ns: int) -> None:
        new_motion, lease_end_ns = (
            motion_commands.drive(arguments, self.allowed),
            lease_end(arguments.lease_s, now_ns),
        )
        self.begin(self._admit_motion(call_id.caller, now_ns), new_motion, lease_end_ns=lease_end_ns)

    def _go(self, call_id: CallId, arguments: robot.Go, now_ns: int, integrating: bool = True) -> None:
        previous, lease_end_ns = self._previous(call_id.caller), lease_end(arguments.lease_s, now_ns)
        new_motion, settings = motion_commands.go(
            arguments, self._settings, self.allowed, previous, integrating=integrating
        )
        self.begin(self._admit_motion(call_id.caller, now_ns), new_motion, lease_end_ns=lease_end_ns)
        self._settings = settings

    def _proportional_go(self, call_id: CallId, arguments: robot.Go, now_ns: int) -> None:
        self._go(call_id, arguments, now_ns, integrating=False)

    def _jog(self, call_id: CallId, arguments: robot.Jog, now_ns: int) -> None:
        previous, lease_end_ns = self._previous(call_id.caller), lease_end(arguments.lease_s, now_ns)
        new_motion = motion_commands.jog(arguments, self._settings, self.allowed, previous)
        self.begin(self._admit_motion(call_id.caller, now_ns), new_motion, lease_end_ns=lease_end_ns)

    def _halt(self, call_id: CallId, arguments: robot.Halt, now_ns: int) -> None:
        lease_end_ns = lease_end(arguments.lease_s, now_ns)
        new_motion = motion_commands.halt(arguments, self._settings)
        self.begin(self.admit(call_id.caller, self._contest), new_motion, lease_end_ns=lease_end_ns)

    def _move(self, call_id: CallId, arguments: robot.Move, now_ns: int) -> Later | None:
        new_motion, settings = motion_commands.move(arguments, self._settings, self.allowed)
        answer = self._set_motion(call_id, new_motion, arguments.wait, now_ns)
        self._settings = settings
        return answer

    def _turn(self, call_id: CallId, arguments: robot.Turn, now_ns: int) -> Later | None:
        new_motion, settings = motion_commands.turn(arguments, self._settings, self.allowed)
        answer = self._set_motion(call_id, new_motion, arguments.wait, now_ns)
        self._settings = settings
        return answer

    def _continuous_turn(self, call_id: CallId, arguments: robot.ContinuousTurn, now_ns: int) -> Later | None:
        new_motion, settings = motion_commands.continuous_turn(arguments, self._settings, self.allowed)
        answer = self._set_motion(call_id, new_motion, arguments.wait, now_ns)
        self._settings = settings
        return answer

    def _previous(self, caller: Caller) -> Motion | None:
        commander = self.outside_commanders.find(caller)
        return None if commander is None else commander.command


def _stalled(progress: str, commander: Commander[Motion]) -> RefusedError:
    """Return the refusal of a connection's motion without progress."""
    seconds = f"{motion.STALL_TIMEOUT_S:g} s"
    if commander.held_at_rest and commander.fault == LIMITS_UNKNOWN:
        found = f"the program's limits were unknown for {seconds}, after {progress}"
        return RefusedError("limits", f"{found}: its clients are late or lost")
    if commander.held_at_rest:
        return RefusedError("limits", f"the program's limits held the base for {seconds}, after {progress}")
    return RefusedError("stalled", f"no progress for {seconds}, after {progress}")
