"""Images of simulated cameras, which are taken at once and drawn row by row when they are read."""

from __future__ import annotations

from colony.runtime.protocol.images import Image
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.drivers import image_of
from colony.sim.world.world import World


class CeilingShot:
    """A shot of the ceiling by a robot's camera at `t_ns`."""

    channels = 1

    def __init__(self, ceiling: CeilingCamera, world: World, robot: int, t_ns: int) -> None:
        self._ceiling = ceiling
        self._pose = world.true_pose(robot)
        self._t_ns = t_ns
        self.height, self.width = ceiling.config.height, ceiling.config.width

    def rows(self, first: int, count: int) -> Image:
        """Return `count` rows of the image from row `first` on."""
        if first < 0 or count <= 0 or first + count > self.height:
            raise ValueError(
                f"{count} rows from row {first} on; expected at least 1 of rows 0 to {self.height - 1}"
            )
        pixels = self._ceiling.rows(self._pose, self._t_ns, range(first, first + count))
        return image_of(pixels, self._t_ns, first)


class LevelShot:
    """A shot by a robot's camera that looks along the floor, at `t_ns`.

    It shows robots, people and doors at the time of the shot.
    """

    channels = 1

    def __init__(self, camera: Camera, world: World, robot: int, t_ns: int) -> None:
        self._draw = camera.shot(world, robot, t_ns)
        self._t_ns = t_ns
        self.height, self.width = camera.config.height, camera.config.width

    def rows(self, first: int, count: int) -> Image:
        """Return `count` rows of the image from row `first` on."""
        return image_of(self._draw(first, count), self._t_ns, first)
