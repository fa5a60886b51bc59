"""How long the ceiling light tracker takes for a look: three scan lines of 240 pixels, from the simulator.

A fixed loop of plain Python and numpy is timed beside it, so that figures of other machines can be compared.
Figures are the best of several batches that take turns.

    python -m benchmarks.vision
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.simulation import calibration
from colony.nav.stickrep_reader import load_map
from colony.sim.ceiling import CeilingCamera
from colony.sim.hazards import Hazards, draw
from colony.vision.along_track import Scale
from colony.vision.ceiling_camera import UPWARD
from colony.vision.light_track import LightGoal, LightTrack, Seen
from colony.vision.scan_lines import Lines, ceiling_lights

Row = dict[str, object]

TARGET_MS = 1.0
ROUNDS, BATCH = 15, 100
LOOKS = 40

MAP = Path(__file__).resolve().parent.parent / "maps" / "msu_engineering_3.stickrep"


def images(hazards: Hazards, *, seed: int = 1) -> list[Lines]:
    """The scan lines of a passage below a light, from well before it to well behind."""
    scenery = draw(hazards, load_map(MAP), seed)
    camera = CeilingCamera(scenery)
    light = next((lamp for lamp in scenery.lights if lamp.brightness == 1.0), scenery.lights[0])
    heading = math.radians(light.heading_deg)
    found = []
    for look in range(LOOKS):
        along = -1000.0 + 2000.0 * look / LOOKS
        pose = (light.x_mm - along * math.sin(heading), light.y_mm + along * math.cos(heading))
        found.append(camera.rows((*pose, light.heading_deg + 4.0), look, UPWARD.scan_rows))
    return found


def run() -> list[Row]:
    """One row a figure: name, value, unit, target (None: only told), ok, note."""
    lit, dark = images(Hazards.none()), images(Hazards(light_out=1.0, light_dim=0.0))
    goal = LightGoal(direction_deg=0.0, x_mm=0.0, y_mm=0.0, lights_mm=(5000.0, 10_000.0))
    track = LightTrack.start(goal, Scale())
    seen = Seen(ceiling_lights(lit[LOOKS // 2], UPWARD), 5000.0, 0.0)
    works: dict[str, Callable[[int], object]] = {
        "lights in three lines, below a light": lambda i: ceiling_lights(lit[i % LOOKS], UPWARD),
        "lights in three lines, none": lambda i: ceiling_lights(dark[i % LOOKS], UPWARD),
        "the track, a light": lambda _: track.seen(seen).passing(4900.0),
    }
    best = dict.fromkeys(works, math.inf)
    for _ in range(ROUNDS):
        for name, work in works.items():
            best[name] = min(best[name], _batch_ms(work))
    rows = [_row(name, ms, TARGET_MS) for name, ms in best.items()]
    fixed = min(_batch_ms(lambda _: calibration(), 1) for _ in range(ROUNDS))
    return [*rows, _row("a fixed piece of work", fixed, None)]


def _batch_ms(work: Callable[[int], object], times: int = BATCH) -> float:
    start = time.perf_counter()
    for i in range(times):
        work(i)
    return (time.perf_counter() - start) / times * 1e3


def _row(name: str, ms: float, target: float | None) -> Row:
    met = target is None or ms <= target
    return {"name": name, "value": ms, "unit": "ms", "target": target, "ok": met, "note": ""}


if __name__ == "__main__":
    for row in run():
        print(row)
