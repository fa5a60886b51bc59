"""Control of the base by connections outside the network: their motions.

The pilot handles the calls of Table 4.1 that move the base, under the rules of `outside_control.py`. In each
frame, it steps the motion of the connection that may act. Arbitration decides, and hands the step back with
the dispatch, so that only a motion that was carried out progresses. The pilot does not use a driver.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Literal, NamedTuple

import msgspec

from colony.runtime.arbitration import motion
from colony.runtime.arbitration.arbiter import Dispatch
from colony.runtime.arbitration.frame_bounds import LIMITS_UNKNOWN
from colony.runtime.arbitration.motion import FiniteMotion, Mode, Motion, Speeds, Step
from colony.runtime.arbitration.outside import Commander, OutsideCommanders, lease_end
from colony.runtime.library import robot
from colony.runtime.protocol.calls import (
    LATER,
    CallId,
    Handler,
    Later,
    Method,
    NoArguments,
    RefusedError,
    method,
)
from colony.runtime.protocol.deployment import ActuatorSpec
from colony.runtime.servers import motion_commands
from colony.runtime.servers.base import Base, Bumper
from colony.runtime.servers.base_actuator import DRIVE, allowed_range, speeds_of, values_of
from colony.runtime.servers.motion_commands import Context, Made, Range, full_range
from colony.runtime.servers.outside_control import ActuatorState, OutsideControl, Proposal

MakeMotion = Callable[[Any, Context], Made]
"""A function that returns the motion of a call with these arguments."""

_MOTIONS: tuple[tuple[str, type[msgspec.Struct], MakeMotion], ...] = (
    ("drive", robot.Drive, motion_commands.drive),
    ("go", robot.Go, motion_commands.go),
    ("proportional_go", robot.Go, partial(motion_commands.go, integrating=False)),
    ("jog", robot.Jog, motion_commands.jog),
    ("stop", robot.Halt, motion_commands.halt),
    ("move", robot.Move, motion_commands.move),
    ("turn", robot.Turn, motion_commands.turn),
    ("continuous_turn", robot.ContinuousTurn, motion_commands.continuous_turn),
)


class _Stepped(NamedTuple):
    """A frame of a motion: its step, and its speeds within the allowed range."""

    commander: Commander[Motion]
    step: Step
    speeds: Speeds


class Pilot(OutsideControl[Motion]):
    """The motions of outside connections. Mutable.

    `speeds` are those that the connection that acts commands, None if none acts. `stops_immediately` is True
    if it stops the base by its emergency stop.

    Args:
        state: the base's actuator.
        base: the base. While it does not report a state, motions are refused.
    """

    def __init__(self, state: ActuatorState, base: Base) -> None:
        super().__init__(state)
        self._commanders[DRIVE] = OutsideCommanders()
        self._base = base
        self._settings = motion_commands.initial_settings(base.limits)
        self._range: tuple[ActuatorSpec | None, Range] = (None, full_range(base.limits))
        self.mode: Mode = "joystick"
        self.speeds: Speeds | None = None
        self.stops_immediately = False

    @property
    def methods(self) -> tuple[Method, ...]:
        """The methods of the pilot."""
        motions = (method(name, kind, self._handler(make)) for name, kind, make in _MOTIONS)
        mode = method("mode", NoArguments, lambda *_: self.mode, right="read")
        return (*motions, mode, *super().methods)

    # --- frames --------------------------------------------------------------------------------------

    def _propose(
        self, spec: ActuatorSpec, commander: Commander[Motion], may_act: bool, now_ns: int
    ) -> Proposal | None:
        assert commander.command is not None
        if not may_act:
            return Proposal(())
        step = motion.step(commander.command, self._base.observation(now_ns, self.state.frame_ns))
        held_since_ns = commander.held_since_ns
        if held_since_ns is not None and now_ns - held_since_ns > motion.STALL_TIMEOUT_S * 1e9:
            step = step._replace(end=step.end or "stalled")
        if step.end is not None:
            self._end(commander, step.end)
            return None
        speeds = self._allowed(spec).clamp(step.speeds)
        return Proposal(values_of(spec, speeds), _Stepped(commander, step, speeds))

    def on_dispatch(self, spec: ActuatorSpec, dispatch: Dispatch, now_ns: int) -> None:
        """Advance the motion of the connection that acts in the frame, if any; interrupt all others."""
        stepped = dispatch.source if isinstance(dispatch.source, _Stepped) else None
        for commander in self._drivers.commanding:
            if commander.command is not None and (stepped is None or commander is not stepped.commander):
                commander.command = motion.interrupt(commander.command)
        self.speeds, self.stops_immediately = None, False
        if stepped is not None:
            self._advance(stepped, spec, dispatch, now_ns)
        elif dispatch.hold != "stopped":
            self._on_network_dispatch(is_active=dispatch.by is not None)

    def _advance(self, stepped: _Stepped, spec: ActuatorSpec, dispatch: Dispatch, now_ns: int) -> None:
        commander, step, proposed = stepped
        sent = None
        if dispatch.fault is None and dispatch.values is not None:
            sent = speeds_of(spec, dispatch.values, proposed)
        self.speeds, self.stops_immediately = sent, motion.is_immediate_halt(step.motion)
        if commander.command is None:  # it ended before the frame was decided
            return
        commander.command = step.motion if sent else motion.interrupt(step.motion)
        commander.fault = dispatch.fault
        commander.held_at_rest = motion.is_held_at_rest(step.motion, proposed, sent)
        if not (commander.held_at_rest and motion.is_stalling(step.motion)):
            commander.held_since_ns = None
        elif commander.held_since_ns is None:
            commander.held_since_ns = now_ns
        self.mode = motion.mode(step.motion)

    def _on_network_dispatch(self, *, is_active: bool) -> None:
        """Set the mode for a frame without an outside command; `is_active` is True if a client won."""
        if is_active:
            self.mode = "jog"
        elif self.mode in ("continuous turn", "point-to-point go", "point-to-point turn"):
            self.mode = "go"

    def on_bumper(self, connection: str | None, bumper: Bumper) -> None:
        """End the move or arc of a connection, because a bumper stopped it."""
        for commander in self._drivers.commanding:
            moving = isinstance(commander.command, motion.Move | motion.Arc)
            if moving and commander.caller.connection == connection:
                self._end(commander, bumper)

    def _end(self, commander: Commander[Motion], reason: Literal["done", "stalled", "front", "rear"]) -> None:
        ended, call_id = commander.command, commander.call_id
        commander.end()
        self.mode = "go"
        if call_id is None or not isinstance(ended, FiniteMotion):
            return
        unit = "mm" if isinstance(ended, motion.Move) else "deg"
        progress = motion.measure_progress(ended, self._base.continuous_pose)
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
            robot.OutsideReport(commands=None if command is None else motion.call_of(command), **common)
            for _, command, common in self._reported(now_ns)
        )

    def stop(self) -> None:
        """Cancel all commands because of the emergency stop."""
        super().stop()
        self.mode = "joystick"

    # --- calls ---------------------------------------------------------------------------------------

    @property
    def _drivers(self) -> OutsideCommanders[Motion]:
        return self._commanders[DRIVE]

    def _allowed(self, spec: ActuatorSpec) -> Range:
        if self._range[0] is not spec:
            self._range = spec, allowed_range(spec, self._base.limits)
        return self._range[1]

    def _handler(self, make: MakeMotion) -> Handler:
        """Return the handler of a call that moves the base.

        Most motions stay in force until the lease of the call ends; those with an end of their own until they
        are done, and may wait for it. Stopping needs neither ticks nor the state of the base.
        """

        def handle(call_id: CallId, arguments: Any, now_ns: int) -> Later | None:
            spec, caller = self.state.actuators[DRIVE], call_id.caller
            contest, commander = self.contest(spec), self._drivers.find(caller)
            previous = None if commander is None else commander.command
            context = Context(self._settings, self._allowed(spec), previous)
            new_motion, settings = make(arguments, context)
            is_finite = isinstance(new_motion, FiniteMotion)
            lease_end_ns = None if is_finite else lease_end(arguments.lease_s, now_ns)
            if isinstance(new_motion, motion.Halt):
                commander = self.admit(caller, contest)
            else:
                commander = self.admit_while_ticking(caller, contest, now_ns)
                self._base.require_state()
            waiting = call_id if is_finite and arguments.wait else None
            self.begin(commander, new_motion, lease_end_ns=lease_end_ns, call_id=waiting)
            self._settings = settings
            return None if waiting is None else LATER

        return handle


def _stalled(progress: str, commander: Commander[Motion]) -> RefusedError:
    """Return the refusal of a connection's motion without progress."""
    seconds = f"{motion.STALL_TIMEOUT_S:g} s"
    if commander.held_at_rest and commander.fault == LIMITS_UNKNOWN:
        found = f"the program's limits were unknown for {seconds}, after {progress}"
        return RefusedError("limits", f"{found}: its clients are late or lost")
    if commander.held_at_rest:
        return RefusedError("limits", f"the program's limits held the base for {seconds}, after {progress}")
    return RefusedError("stalled", f"no progress for {seconds}, after {progress}")
