"""Writes a set of pictures with their truth: python -m tools.second_renderer --seed 1 -o FOLDER"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from PIL import Image

from benchmarks.arguments import whole_number
from colony.nav.maps.signs import MARKER_CODES
from tools.second_renderer.render import render
from tools.second_renderer.scenes import Scene, ceiling_scene, marker_scene, plate_scene

SAMPLES = {240: 27, 320: 18, 640: 18}
"""Paths of light a pixel, by the columns of the image."""


def scenes(seed: int, count: int) -> Iterator[tuple[str, int, Callable[[], Scene]]]:
    """The names and seeds of the scenes of a set, and what makes each: `count` walls, a fifth of them without
    plates, and less than a third as many elevators and ceilings each."""
    for i in range(count):
        size = (640, 480) if i % 20 == 7 else (320, 240) if i % 8 == 3 else (240, 120)
        own, has = seed * 1000 + i, i % 5 != 4
        yield f"{'plates' if has else 'walls'}_{i:02}", own, partial(plate_scene, own, plates=has, size=size)
    for i in range(count * 2 // 7):
        own, code = seed * 1000 + 300 + i, MARKER_CODES[(i - i // 5) % len(MARKER_CODES)]
        size, shut = (320, 240) if i % 6 == 2 else (240, 120), i % 5 != 4
        made = partial(marker_scene, own, code=code if shut else None, size=size)
        yield f"{'markers' if shut else 'doors'}_{i:02}", own, made
    for i in range(count * 2 // 7):
        own, lights = seed * 1000 + 600 + i, ("on", "on", "out", "on", "none")[i % 5]
        yield f"ceiling_{i:02}", own, partial(ceiling_scene, own, lights=lights)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tools.second_renderer", description=__doc__)
    parser.add_argument(
        "--seed", type=whole_number("seed", 0), required=True, help="another one draws other scenes"
    )
    parser.add_argument(
        "--count", type=whole_number("number of walls", 1), default=44, help="of walls (default: 44)"
    )
    parser.add_argument("--only", default="", help="only pictures whose names begin so")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FOLDER", help="made if it is not there"
    )
    arguments = parser.parse_args()
    if not any(name.startswith(arguments.only) for name, _, _ in scenes(arguments.seed, arguments.count)):
        parser.error(f"no picture begins with `{arguments.only}`; expected as plates_01, markers or ceiling")
    arguments.output.mkdir(parents=True, exist_ok=True)
    images: list[dict[str, Any]] = []
    for name, own, made in scenes(arguments.seed, arguments.count):
        if not name.startswith(arguments.only):
            continue
        scene = made()
        picture, targets = render(scene, seed=own, samples=SAMPLES[scene.view.size[0]])
        Image.fromarray(picture).save(arguments.output / f"{name}.png", optimize=True)
        images.append(
            {"file": f"{name}.png", "camera": scene.view.kind, "font": scene.font, "targets": targets}
        )
        print(
            name, *(f"{t['kind']} {t.get('text', t.get('code', t.get('on')))}" for t in targets), flush=True
        )
        truth = {"seed": arguments.seed, "walls": arguments.count, "images": images}
        (arguments.output / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
