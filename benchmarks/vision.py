"""How long detectors take for an image of 240 x 120 pixels, and the simulator to render one, on one core.

Lights are looked for in three scan lines of the ceiling, plates and markers in a whole image of a camera that
looks along the floor; images are the simulator's, of a passage below a light, past a plate, and up to an
elevator, with all hazards. The time is the processor's, of all threads together, so that what others do on
the machine does not count. A fixed loop of plain Python and numpy is timed beside it, so that figures of
other machines can be compared. Figures are the best of several batches that take turns.

    python -m benchmarks.vision
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.simulation import calibration
from colony.nav.maps.signs import Sign, markers_of, plates_of
from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.stickrep.reader import load_map
from colony.sim.cameras.camera import Camera
from colony.sim.cameras.ceiling import CeilingCamera
from colony.sim.cameras.scene import scene_of
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.world.world import Speed
from colony.vision.lights.ceiling_camera import UPWARD
from colony.vision.lights.scan_lines import Lines, ceiling_lights
from colony.vision.lights.track import LightDetections, LightGoal, LightTrack, OdometryScale
from colony.vision.markers.rows import find_markers
from colony.vision.plates.detector import find_plates
from colony.vision.plates.reader import read_plate
from tests.sim.robots import FRONT_CAMERA

Row = dict[str, object]
Image = NDArray[np.uint8]

LIGHTS_MS, PLATES_MS, MARKERS_MS = 1.0, 10.0, 5.0
IMAGE_MS = 1000.0 / 200.0
"""The promised limits; of a rendered image, 200 of them a second."""

ROUNDS, BATCH = 8, 40
PERSON_STYLES = 40

MAP = Path(__file__).resolve().parent.parent / "maps" / "msu_engineering_3.stickrep"


def ceilings(hazards: Hazards, *, seed: int = 1) -> list[Lines]:
    """The scan lines of a passage below a light, from well before it to well behind."""
    scenery = draw(hazards, load_map(MAP), seed)
    camera = CeilingCamera(scenery)
    light = next((lamp for lamp in scenery.lights if lamp.brightness == 1.0), scenery.lights[0])
    heading = math.radians(light.heading_deg)
    found = []
    for look in range(PERSON_STYLES):
        along = -1000.0 + 2000.0 * look / PERSON_STYLES
        pose = (light.x_mm - along * math.sin(heading), light.y_mm + along * math.cos(heading))
        found.append(camera.rows((*pose, light.heading_deg + 4.0), look, UPWARD.scan_rows))
    return found


class Views:
    """A camera on the floor of the published runs, with all hazards, that looks at signs."""

    def __init__(self, floor: Map, *, seed: int = 1) -> None:
        self._camera = Camera(
            scene_of(floor, draw(Hazards(), floor, seed)), FRONT_CAMERA, robot_radius_mm=400.0, seed=seed
        )

    def of(self, sign: Sign, distance_mm: float, aside_mm: float, look: int) -> Image:
        """A sign from so far, with the robot so far to the right of who faces it, turned by 4 degrees."""
        heading = math.radians(sign.heading_deg)
        ahead, right = (-math.sin(heading), math.cos(heading)), (math.cos(heading), math.sin(heading))
        x = sign.center.x - distance_mm * ahead[0] + aside_mm * right[0]
        y = sign.center.y - distance_mm * ahead[1] + aside_mm * right[1]
        pose = np.array([[x, y, sign.heading_deg + 4.0]])
        return self._camera.image(pose, 0, look, people=np.zeros((0, 2)), speed=Speed(500.0, 0.0))

    def passage(self, sign: Sign) -> list[Image]:
        """A plate while the robot passes it in the middle of a corridor."""
        return [
            self.of(sign, 1200.0, -700.0 + 1400.0 * look / PERSON_STYLES, look)
            for look in range(PERSON_STYLES)
        ]

    def approach(self, sign: Sign) -> list[Image]:
        """A marker while the robot drives up to it."""
        return [
            self.of(sign, 3000.0 - 1800.0 * look / PERSON_STYLES, 100.0, look)
            for look in range(PERSON_STYLES)
        ]


def _read(image: Image) -> None:
    for box in find_plates(image):
        read_plate(image, box)


def run() -> list[Row]:
    """One row a figure: name, value, unit, target (None: only told), ok, note."""
    cv2.setNumThreads(1)
    floor = load_map(MAP)
    views, plate, marker = Views(floor), plates_of(floor)[0], markers_of(floor)[0]
    lit, dark = ceilings(Hazards.none()), ceilings(Hazards(light_out=1.0, light_dim=0.0))
    doors, lifts = views.passage(plate), views.approach(marker)
    goal = LightGoal(direction_deg=0.0, x_mm=0.0, y_mm=0.0, lights_mm=(5000.0, 10_000.0))
    track = LightTrack.start(goal, OdometryScale())
    seen = LightDetections(ceiling_lights(lit[PERSON_STYLES // 2], UPWARD), 5000.0, 0.0)
    works: dict[str, tuple[Callable[[int], object], float]] = {
        "lights in three lines, below a light": (lambda i: ceiling_lights(lit[i], UPWARD), LIGHTS_MS),
        "lights in three lines, none": (lambda i: ceiling_lights(dark[i], UPWARD), LIGHTS_MS),
        "the track, a light": (lambda _: track.observed(seen).passing(4900.0), LIGHTS_MS),
        "plates found, passing a door": (lambda i: find_plates(doors[i]), PLATES_MS),
        "plates found and read, passing a door": (lambda i: _read(doors[i]), PLATES_MS),
        "markers found, driving up to an elevator": (lambda i: find_markers(lifts[i]), MARKERS_MS),
        "markers found, passing a door": (lambda i: find_markers(doors[i]), MARKERS_MS),
        "an image of a wall with a plate rendered": (
            lambda i: views.of(plate, 1200.0, 35.0 * i - 700.0, i),
            IMAGE_MS,
        ),
    }
    best = dict.fromkeys(works, math.inf)
    for _ in range(ROUNDS):
        for name, (work, _) in works.items():
            best[name] = min(best[name], _batch_ms(work))
    rows = [_row(name, ms, works[name][1], _note(name, ms)) for name, ms in best.items()]
    fixed = min(_batch_ms(lambda _: calibration(), 1) for _ in range(ROUNDS))
    return [*rows, _row("a fixed piece of work", fixed, None)]


def _note(name: str, ms: float) -> str:
    rate = f"; {1e3 / ms:.0f} images/s" if name.endswith("rendered") else ""
    return f"promised{rate}"


def _batch_ms(work: Callable[[int], object], times: int = BATCH) -> float:
    start = time.process_time()
    for i in range(times):
        work(i)
    return (time.process_time() - start) / times * 1e3


def _row(name: str, ms: float, target: float | None, note: str = "") -> Row:
    met = target is None or ms <= target
    return {"name": name, "value": ms, "unit": "ms", "target": target, "ok": met, "note": note}


if __name__ == "__main__":
    for row in run():
        print(row)
