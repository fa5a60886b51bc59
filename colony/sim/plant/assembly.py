"""The devices of a plant, assembled from its options: the world, and what the robots have in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from colony.body.model import Body
from colony.body.servers import servers_of
from colony.ir.servers import ServerSpec
from colony.nav.maps.building import Building
from colony.nav.maps.free_space import FreeSpace
from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.world_map import WorldMap
from colony.sim.config import RobotConfig, config_of, rome_config
from colony.sim.devices import devices_of
from colony.sim.hazards.hazards import Hazards, scenery_of
from colony.sim.hazards.scenery import Scenery
from colony.sim.plant.hardware import STEP_NS, Devices, GivenFields, RobotCamera, RobotDevice
from colony.sim.world.elevators import Elevators
from colony.sim.world.movers import with_movers
from colony.sim.world.site import SimulatedSite
from colony.sim.world.world import World
from colony.sim.world_spec import WorldSpec

if TYPE_CHECKING:  # compiled when they are imported, which robots without cameras do not wait for
    from colony.sim.cameras.camera import CameraConfig
    from colony.sim.cameras.ceiling import CeilingCameraConfig


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantOptions:
    """A plant, with the files of its world loaded.

    Attributes:
        path: path of the socket, in the private folder of a robot that this process has claimed.
        spec: the specification of the world.
        world: its map, loaded.
        building: the building of this map, if elevators take the robots to other floors.
        robots: initial poses by name: x, y in mm, heading in degrees counterclockwise from north.
        cameras: cameras of each robot, by name.
        hazards: the hazards that the spec's seed draws; by default the usual ones if it has such a seed.
        body: the body of the robots; None for one that has no devices but those of `config` and `cameras`.
        servers: the servers of the body whose devices are simulated, with what they offer; those that follow
            from the body alone by default.
        config: the parameters of the robots; those of the body by default, of RoME without one.
        step_ns: step of the simulation.
    """

    path: Path
    spec: WorldSpec = field(default_factory=WorldSpec)
    world: WorldMap
    building: Building | None = None
    robots: Mapping[str, tuple[float, float, float]]
    cameras: Mapping[str, CameraConfig | CeilingCameraConfig] = field(default_factory=dict)
    hazards: Hazards | None = None
    body: Body | None = None
    servers: tuple[ServerSpec, ...] | None = None
    config: RobotConfig | None = None
    step_ns: int = STEP_NS

    @property
    def drawn_hazards(self) -> Hazards:
        """The hazards that are drawn."""
        if self.hazards is not None:
            return self.hazards
        return Hazards.none() if self.spec.hazards is None else Hazards()


def assembled_devices(options: PlantOptions, clock: Callable[[], int]) -> Devices:
    """Return the devices of a plant, ready to be read at once.

    Raises:
        ValueError: a robot does not fit, or there is no room for people.
        DiagnosticError: a grid is to have hazards or cameras, which require a building.
    """
    config = options.config or (rome_config() if options.body is None else config_of(options.body))
    stage = _stage(options, config)
    given = GivenFields()
    robot_devices = [_robot_devices(options, stage.world, robot, given) for robot in range(len(stage.world))]
    devices = Devices(
        stage.world,
        tuple(options.robots),
        stage.cameras,
        robot_devices,
        floor=options.world.name,
        elevators=stage.elevators,
        given=given,
        now_ns=clock(),
        step_ns=options.step_ns,
    )
    for name in stage.cameras:  # warm up, so that the first real images and readings are not slow
        devices.image(0, name)
    for server in robot_devices[0]:
        devices.device(0, server)
    if config.channels:
        stage.world.sonar(0)
    return devices


@dataclass(frozen=True, slots=True, kw_only=True)
class _Stage:
    """The world with its robots, the elevators to other floors, and the cameras of the robots' floor."""

    world: World
    elevators: Elevators | None = None
    cameras: Mapping[str, Callable[[], RobotCamera]]


def _stage(options: PlantOptions, config: RobotConfig) -> _Stage:
    if options.building is None:
        return _single_floor(options, config)
    site = SimulatedSite(
        options.building,
        options.spec.floors,
        options.drawn_hazards,
        poses=list(options.robots.values()),
        seed=options.spec.hazards or 0,
        noise_seed=options.spec.seed,
        config=config,
    )
    # All of them now: a scene takes longer than a ride may keep the plant from its steps.
    cameras = {
        name: _cameras(options, floor, site.sceneries[name], config.radius_mm)
        for name, floor in site.maps.items()
    }

    def current_camera(name: str) -> RobotCamera:
        return cameras[site.floor][name]

    return _Stage(
        world=site.world,
        elevators=site.elevators,
        cameras={name: partial(current_camera, name) for name in options.cameras},
    )


def _single_floor(options: PlantOptions, config: RobotConfig) -> _Stage:
    scenery = populated_scenery(options)
    world = World(walls=scenery, poses=list(options.robots.values()), config=config, seed=options.spec.seed)
    if not options.cameras:
        return _Stage(world=world, cameras={})
    cameras = _cameras(options, options.world.building("a camera"), scenery, config.radius_mm)
    return _Stage(world=world, cameras={name: partial(cameras.__getitem__, name) for name in cameras})


def populated_scenery(options: PlantOptions) -> Scenery:
    """Return the scenery of a plant without elevators, with all of its people.

    Raises:
        DiagnosticError: a grid is to have hazards.
        NoRoomError: there is no room for people.
    """
    spec = options.spec
    scenery = scenery_of(options.world, options.drawn_hazards, spec.hazards or 0)
    if not (spec.movers and options.robots):
        return scenery
    (x, y, _), *_ = options.robots.values()
    return with_movers(scenery, lambda: FreeSpace(options.world), (x, y), spec.movers, seed=spec.seed)


def _cameras(
    options: PlantOptions, floor: Map, scenery: Scenery, radius_mm: float
) -> Mapping[str, RobotCamera]:
    """Return the cameras of a robot on a floor, by name."""
    if not options.cameras:
        return {}
    from colony.sim.cameras.camera import Camera
    from colony.sim.cameras.ceiling import CeilingCamera, CeilingCameraConfig
    from colony.sim.cameras.scene import scene_of

    def camera(config: CameraConfig | CeilingCameraConfig) -> RobotCamera:
        if isinstance(config, CeilingCameraConfig):
            ceiling = CeilingCamera(scenery, config)
            return lambda world, robot, t_ns: ceiling.image(world.true_pose(robot), t_ns)
        return Camera(scene_of(floor, scenery), config, robot_radius_mm=radius_mm, seed=options.spec.seed).see

    return {name: camera(config) for name, config in options.cameras.items()}


def _robot_devices(
    options: PlantOptions, world: World, robot: int, given: GivenFields
) -> Mapping[str, RobotDevice]:
    """Return the devices of a robot besides its base, ring and cameras, by the names of their servers."""
    body = options.body
    if body is None:
        return {}
    servers = servers_of(body) if options.servers is None else options.servers
    return devices_of(body, servers, world, robot, seed=options.spec.seed, given=given.of(robot))
