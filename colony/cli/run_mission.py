"""`colony run --from ROOM --to ROOM`: the clients that lead a robot through a building, among its servers."""

from __future__ import annotations

import math

from colony.cli.run_options import Misuse, Options
from colony.experiment.runs import AT_GOAL_MM, CORNER_S
from colony.experiment.variants import CEILING_CAMERA, OURS, PLANNER
from colony.experiment.watching import PATIENCE
from colony.nav.plan import Plan
from colony.nav.route import NoPlan, plan
from colony.nav.stickrep import Map
from colony.nav.walls import walls_of
from colony.runtime.assembly import frames_kept
from colony.runtime.fields import DSERVER, PSERVER, RSERVER
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.messages import Node
from colony.runtime.servers.cserver import CServer
from colony.sim.ceiling import CeilingCamera
from colony.sim.drivers import Plant, SimulatedCeilingCamera
from colony.sim.hazards import Hazards, draw
from colony.sim.world import World

_SERVERS = (DSERVER.name, RSERVER.name, PSERVER.name, CEILING_CAMERA)
_AFTER_NS = 1_000_000
"""Scripts begin so long after a frame, so that they know what was seen in it."""


class Mission:
    """A way through a building that is to be driven. Mutable: how far its scripts are.

    Raises:
        Misuse: there is no such way.
    """

    def __init__(self, building: Map, options: Options, frame_ns: int) -> None:
        assert options.origin is not None
        assert options.goal is not None
        try:
            self.plan: Plan = plan(building, options.origin, options.goal)
        except NoPlan as problem:
            raise Misuse(f"{options.map_path}: error: {problem}") from None
        hazards = Hazards.none() if options.hazards is None else Hazards()
        self._scenery = draw(hazards, building, seed=options.hazards or 0)
        self._seed = options.seed
        self._keep = frames_kept(frame_ns)
        scripts = OURS.scripts(self.plan, walls_of(building))
        self._scripts = {
            name: ScriptNode(name, script, _SERVERS, delay_ns=_AFTER_NS) for name, script in scripts.items()
        }

    def world(self) -> World:
        """The building, with the robot where the way begins."""
        first = self.plan.segments[0]
        pose = (first.start.x_mm, first.start.y_mm, first.heading_deg)
        return World(walls=self._scenery, poses=[pose], seed=self._seed)

    def nodes(self, plant: Plant) -> tuple[Node, ...]:
        """The camera that looks up, and the scripts."""
        camera = SimulatedCeilingCamera(plant, 0, CeilingCamera(self._scenery))
        server = CServer(camera, keep=self._keep, address=CEILING_CAMERA)
        return (server, *self._scripts.values())

    @property
    def longest_ns(self) -> int:
        """After which time it makes no sense to go on."""
        expected_s = self.plan.way_mm / OURS.mm_s + CORNER_S * (1 + self.plan.modes.count("c"))
        return round(PATIENCE * expected_s * 1e9)

    @property
    def problem(self) -> str:
        """What a script raised; "" where none did."""
        for script in self._scripts.values():
            if script.problem is not None:
                return f"{script.address}: {type(script.problem).__name__}: {script.problem}"
        return ""

    def is_over(self) -> bool:
        """Whether the planner is done, or a script has failed."""
        return self._scripts[PLANNER].ended or bool(self.problem)

    def off_mm(self, world: World) -> float:
        """How far the robot really is from the goal."""
        pose, goal = world.true_pose(0), self.plan.segments[-1].end
        return math.hypot(pose.x_mm - goal.x_mm, pose.y_mm - goal.y_mm)

    def arrived(self, world: World) -> bool:
        """Whether the planner is done, and the robot at the goal."""
        done = self._scripts[PLANNER].ended and not self.problem
        return done and self.off_mm(world) <= AT_GOAL_MM

    def told(self, world: World, t_ns: int) -> str:
        """What came of it, in a line."""
        way = f"from {self.plan.origin} to {self.plan.goal} ({self.plan.modes})"
        where, when = f"{self.off_mm(world) / 1000:.2f} m from the goal", f"after {t_ns / 1e9:.1f} s"
        if self.problem:
            return f"{way}: broke off {when}, {where}: {self.problem}"
        if self.arrived(world):
            speed = self.plan.distance_mm / (t_ns / 1e9) * 0.06
            return f"{way}: arrived {when}, {where}; {self.plan.distance_mm / 1000:.1f} m, {speed:.1f} m/min"
        ended = "the planner was done" if self._scripts[PLANNER].ended else "not done"
        return f"{way}: {ended} {when}, {where}"
