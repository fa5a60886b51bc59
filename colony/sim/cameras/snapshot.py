"""Single images of a building, without a running simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from colony.nav.maps.stickrep.model import Map
from colony.sim.cameras.camera import Camera, CameraConfig, rome_camera
from colony.sim.cameras.ceiling import CeilingCamera, rome_ceiling_camera
from colony.sim.cameras.scene import scene_of
from colony.sim.compiled import Bytes2, Floats2
from colony.sim.config import rome_config
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.hazards.scenery import Scenery
from colony.sim.world.world import Speed


def snapshot(
    floor: Map,
    pose: tuple[float, float, float],
    config: CameraConfig,
    *,
    scenery: Scenery | None = None,
    seed: int = 0,
    speed_mm_s: float = 0.0,
) -> Bytes2:
    """Return the image of a robot's camera at a pose (x and y in mm, heading in degrees): (height, width).

    Args:
        floor: the map.
        pose: pose of the robot.
        config: the camera.
        scenery: the building in one run, with people at their initial places; without it all doors are shut,
            and there are no people.
        seed: seed of the noise.
        speed_mm_s: speed of the robot, which blurs near objects.

    Raises:
        ValueError: the pose is not finite, or the lens is not below the ceiling.
    """
    if not all(map(math.isfinite, pose)):
        raise ValueError(f"the pose is {tuple(pose)}; expected finite numbers")
    camera = Camera(scene_of(floor, scenery), config, robot_radius_mm=rome_config().radius_mm, seed=seed)
    return camera.image(
        np.array([pose], dtype=np.float64), 0, 0, people=_people(scenery), speed=Speed(speed_mm_s, 0.0)
    )


def snapshots(
    floor: Map,
    pose: tuple[float, float, float],
    yaws: Mapping[str, float],
    size: tuple[int, int],
    *,
    hazards: int | None,
    speed_mm_s: float,
) -> dict[str, Bytes2]:
    """Return the images of several level cameras, and of `up`, which looks at the ceiling.

    Args:
        floor: the map.
        pose: pose of the robot.
        yaws: direction of each level camera, in degrees counterclockwise from ahead.
        size: width and height of the images.
        hazards: the seed of the building's hazards; None for no hazards.
        speed_mm_s: speed of the robot.

    Raises:
        ValueError: see `snapshot`.
    """
    scenery = draw(Hazards.none() if hazards is None else Hazards(), floor, hazards or 0)
    width, height = size
    images = {}
    for name, yaw in yaws.items():
        config = replace(rome_camera(), width=width, height=height, yaw_deg=yaw)
        images[name] = snapshot(
            floor, pose, config, scenery=scenery, seed=scenery.seed, speed_mm_s=speed_mm_s
        )
    ceiling = CeilingCamera(scenery, replace(rome_ceiling_camera(), width=width, height=height))
    return images | {"up": ceiling.image(pose, 0)}


def png_of(image: Bytes2) -> bytes:
    """Encode an image, (height, width), as a PNG file."""
    from io import BytesIO

    from PIL import Image

    buffer = BytesIO()
    Image.fromarray(image).save(buffer, format="PNG")
    return buffer.getvalue()


def _people(scenery: Scenery | None) -> Floats2:
    people = [] if scenery is None else [p.track.point_at(p.along_mm, p.offset_mm) for p in scenery.people]
    return np.array(people, dtype=np.float64).reshape(-1, 2)
