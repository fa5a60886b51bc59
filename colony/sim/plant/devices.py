"""The hardware of simulated robots without any program.

It runs in its own time, reports readings, and stops a base whose commands have ceased. No I/O, and no clock:
times are arguments. `colony.sim.plant.process` connects it to sockets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import assert_never

from colony.runtime.protocol.images import Image
from colony.runtime.servers.drivers import BaseState
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.compiled import Bytes2
from colony.sim.drivers import base_state, image_of
from colony.sim.plant.protocol import Rings, Truth
from colony.sim.world.world import MAX_STEP_S, World

STEP_NS = 20_000_000
"""Nanoseconds of one step of the simulation: as long as from one report of a base or a ring to the next."""

WATCHDOG_NS = 500_000_000

MOST_BEHIND_NS = 1_000_000_000
"""Largest delay that the plant catches up.

If it is behind by more (its process was stopped, say), it skips the time, in which nothing moves.
"""


Eye = Camera | CeilingCamera
"""A camera of a robot: along the floor, or at the ceiling."""


@dataclass(frozen=False, slots=True, kw_only=True)
class _Command:
    """`at_ns` is when a base was commanded last; None while it stands."""

    at_ns: int | None = None


class Devices:
    """The devices of all robots of a world, in steps of one length. Mutable: the time reached.

    Args:
        world: the robots.
        names: names of the robots, in the order of their numbers.
        cameras: cameras of each robot, by name.
        now_ns: the present.
        step_ns: step of the simulation.
        watchdog_ns: after so much time without a command a base stops; None: never.

    Raises:
        ValueError: there are not as many names as robots, two are the same, or steps have no length.
    """

    def __init__(
        self,
        world: World,
        names: tuple[str, ...],
        cameras: Mapping[str, Eye],
        *,
        now_ns: int,
        step_ns: int = STEP_NS,
        watchdog_ns: int | None = WATCHDOG_NS,
    ) -> None:
        if len(set(names)) != len(world) or len(names) != len(world):
            raise ValueError(f"{len(world)} robots, named {', '.join(names)}; expected a name for each")
        if not 0 < step_ns <= MOST_BEHIND_NS:
            raise ValueError(f"steps of {step_ns} ns; expected above 0, up to {MOST_BEHIND_NS}")
        self._world = world
        self._robots = {name: number for number, name in enumerate(names)}
        self._cameras = cameras
        self._commands = [_Command() for _ in names]
        self.step_ns = step_ns
        self._watchdog_ns = watchdog_ns
        self._skipped_ns = 0
        self.reached_ns = now_ns

    def number(self, robot: str) -> int:
        """Return the number of a robot.

        Raises:
            ValueError: there is none of this name.
        """
        try:
            return self._robots[robot]
        except KeyError:
            known = ", ".join(self._robots)
            raise ValueError(f"there is no robot `{robot}` here; there is {known}") from None

    def check_camera(self, camera: str) -> None:
        """Check that the robots have a camera of this name.

        Raises:
            ValueError: they do not.
        """
        if camera not in self._cameras:
            known = ", ".join(self._cameras) or "none"
            raise ValueError(f"the robots have no camera `{camera}`; they have {known}")

    # --- time ----------------------------------------------------------------------------------------

    def advance(self, now_ns: int) -> None:
        """Let whole steps pass up to the present."""
        behind = now_ns - self.reached_ns
        if behind > MOST_BEHIND_NS:
            skipped = behind // self.step_ns * self.step_ns
            self._skipped_ns += skipped
            self.reached_ns += skipped
        while self.reached_ns + self.step_ns <= now_ns:
            self._guard()
            self._world.advance(self.step_ns / 1e9)
            self.reached_ns += self.step_ns

    def pass_time(self, dt_ns: int) -> None:
        """Let so much time pass, in logical time.

        Raises:
            ValueError: it is not above 0, or too long.
        """
        if not 0 < dt_ns <= MAX_STEP_S * 1e9:
            raise ValueError(f"cannot advance by {dt_ns} ns; expected above 0, up to {MAX_STEP_S:g} s")
        self._world.advance(dt_ns / 1e9)
        self.reached_ns += dt_ns

    def _guard(self) -> None:
        """Stop the bases whose watchdogs have expired."""
        for robot, command in enumerate(self._commands):
            if command.at_ns is not None and not self._in_time(command.at_ns):
                self.halt(robot)

    def _in_time(self, commanded_ns: int) -> bool:
        return self._watchdog_ns is None or self.reached_ns - commanded_ns < self._watchdog_ns

    # --- commands ------------------------------------------------------------------------------------

    def drive(self, robot: int, velocity: float, turn: float) -> None:
        """Set the speeds of a base.

        Raises:
            ValueError: one is not finite.
        """
        self._world.command(robot, velocity, turn)
        self._commands[robot].at_ns = self.reached_ns

    def halt(self, robot: int) -> None:
        """Let a base stand still, as fast as it can brake."""
        self._world.command(robot, 0.0, 0.0)
        self._commands[robot].at_ns = None

    def driven(self, robot: int) -> bool:
        """Return True if a base has a recent command."""
        at_ns = self._commands[robot].at_ns
        return at_ns is not None and self._in_time(at_ns)

    def place(self, robot: int, x: float, y: float, heading: float) -> None:
        """Carry a robot there; `ValueError` if it has no room, or a number is not finite."""
        self._world.place(robot, (x, y, heading))

    # --- readings ------------------------------------------------------------------------------------

    def base(self, robot: int) -> BaseState:
        """Return what a base reports."""
        return base_state(self._world, robot, self.reached_ns)

    def proximity(self, robot: int) -> Rings:
        """Return what the rings of a robot report."""
        return Rings(
            t_ns=self.reached_ns,
            sonar=tuple(self._world.sonar(robot).tolist()),
            infrared=tuple(self._world.infrared(robot).tolist()),
        )

    def image(self, robot: int, camera: str) -> Image:
        """Return what a camera of a robot reports."""
        return image_of(self._pixels(robot, self._cameras[camera]), self.reached_ns)

    def _pixels(self, robot: int, eye: Eye) -> Bytes2:
        match eye:
            case Camera():
                return eye.see(self._world, robot, self.reached_ns)
            case CeilingCamera():
                return eye.image(self._world.true_pose(robot), self.reached_ns)
            case _:
                assert_never(eye)

    def truth(self, robot: int) -> Truth:
        """Return the true state of a robot."""
        pose, speed = self._world.true_pose(robot), self._world.speed(robot)
        return Truth(
            t_ns=self.reached_ns,
            x=pose.x_mm,
            y=pose.y_mm,
            heading=pose.heading_deg,
            velocity=speed.velocity_mm_s,
            turn=speed.turn_deg_s,
            distance=self._world.distance(robot),
            bumps=self._world.bumps(robot),
            driven=self.driven(robot),
            skipped_ns=self._skipped_ns,
        )
