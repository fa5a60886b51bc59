"""What the detectors find in a set of the second renderer's pictures, against what is in them.

    python -m tools.second_renderer.measure [FOLDER]

prints the figures of a set, by default of the one in tests/vision/corpus, which are those of README.md.
Mitsuba is not needed for it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import MARKER_BITS
from colony.vision.detectors import Detection, Detector, detect
from colony.vision.gray_images import gray_image
from colony.vision.image_files import Rgb, decode_image

CORPUS = Path(__file__).resolve().parents[2] / "tests" / "vision" / "corpus"
PAGE = Path(__file__).with_name("README.md")

SAME = 0.5
"""From which intersection over union on a spot is the thing that is there."""

NEAR_COLUMNS = 8.0
"""How far a ceiling light's middle may be off, in columns: 5 cm on the ceiling."""

_FULL_LIGHT = 6.0  # columns from the rim within which an edge has no sky on its other side


class Picture(NamedTuple):
    """A picture of a set, what is in it, and what the detectors for such a picture see."""

    name: str
    image: Rgb
    targets: tuple[dict[str, Any], ...]
    seen: tuple[tuple[Detector, Detection], ...]


class Score(NamedTuple):
    """How a detector did: of `whole` things that are fully visible, how many it found, how many of those it
    read right, and how often it found something where nothing is, in so many pictures."""

    whole: int
    found: int
    right: int
    false: int
    pictures: int
    missed: tuple[str, ...]
    wrong: tuple[str, ...]
    invented: tuple[str, ...]


def pictures(folder: Path = CORPUS) -> Iterator[Picture]:
    """The pictures of a set, looked at: level ones for plates and markers, ceilings for lights."""
    for entry in json.loads((folder / "truth.json").read_text(encoding="utf-8"))["images"]:
        image = decode_image((folder / entry["file"]).read_bytes())
        is_ceiling = entry["camera"] == "ceiling"
        detectors = [Detector.LIGHTS] if is_ceiling else [Detector.PLATES, Detector.MARKERS]
        seen = tuple((d, detection) for d in detectors for detection in detect(d, gray_image(image)))
        targets = tuple({**target, "ceiling": is_ceiling} for target in entry["targets"])
        yield Picture(Path(entry["file"]).stem, image, targets, seen)


def score(detector: Detector, looked_at: list[Picture]) -> Score:
    """How a detector did on those of the pictures that are for it."""
    kind = {Detector.PLATES: "plate", Detector.MARKERS: "marker", Detector.LIGHTS: "light"}[detector]
    own = [p for p in looked_at if p.name.startswith("ceiling") == (detector is Detector.LIGHTS)]
    whole, found, right, false = 0, 0, 0, 0
    missed: list[str] = []
    wrong: list[str] = []
    invented: list[str] = []
    for picture in own:
        left = [detection for d, detection in picture.seen if d is detector]
        for target in picture.targets:
            if target["kind"] != kind:
                continue
            hits = [detection for detection in left if _is_same(detector, target, detection)]
            left = [
                detection
                for detection in left
                if not (hits and detection is hits[0]) and not _touches(target, detection)
            ]
            if not _counts(target):
                # A dark light must not be seen; what is cut off may be seen, and need not be.
                false += kind == "light" and not target["on"] and len(hits)
                continue
            whole += 1
            found += bool(hits)
            if not hits:
                missed.append(picture.name)
            elif hits[0].label == _label(target):
                right += 1
            else:
                wrong.append(f"{picture.name}: {_label(target)} read as {hits[0].label or 'nothing'}")
        false += len(left)
        invented += [picture.name] * len(left)
    return Score(whole, found, right, false, len(own), tuple(missed), tuple(wrong), tuple(invented))


def _label(target: dict[str, Any]) -> str:
    match target["kind"]:
        case "plate":
            return str(target["text"])
        case "marker":
            return format(target["code"], f"0{MARKER_BITS}b")
        case _:
            return ""


def _counts(target: dict[str, Any]) -> bool:
    """Whether a detector has to find it: a light is wider than the image, and counts where both of its edges
    are in it."""
    if target["kind"] != "light":
        return bool(target["whole"])
    near, far = _light_edges(target)
    return bool(target["on"]) and near > _FULL_LIGHT and far < 239.0 - _FULL_LIGHT


def _light_edges(target: dict[str, Any]) -> tuple[float, float]:
    """In which columns of the middle row the near and the far edge of a light are."""
    corners = target["corners"]
    return _column_at(corners[2], corners[3], 59.5), _column_at(corners[0], corners[1], 59.5)


def _column_at(one: list[float], other: list[float], row: float) -> float:
    return one[0] + (other[0] - one[0]) * (row - one[1]) / (other[1] - one[1])


def _is_same(detector: Detector, target: dict[str, Any], detection: Detection) -> bool:
    if detector is Detector.LIGHTS:
        middle = sum(column for column, _ in detection.corners) / 4.0
        return abs(middle - sum(_light_edges(target)) / 2.0) <= NEAR_COLUMNS
    return overlap(np.array(target["corners"]), np.array(detection.corners)) >= SAME


def _touches(target: dict[str, Any], detection: Detection) -> bool:
    """Whether a spot is on a light that is on, or on a thing that is cut off: no invention, at any rate."""
    if target["kind"] == "light":
        near, far = _light_edges(target)
        columns = [column for column, _ in detection.corners]
        return bool(target["on"]) and min(columns) < far and max(columns) > near
    if target["whole"]:
        return False
    return overlap(np.array(target["corners"]), np.array(detection.corners)) > 0.2


def overlap(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """The intersection of two convex outlines over their union."""
    first, second = one.astype(np.float32), other.astype(np.float32)
    shared = float(cv2.intersectConvexConvex(first, second)[0])
    union = float(cv2.contourArea(first) + cv2.contourArea(second)) - shared
    return shared / union if union > 0.0 else 0.0


def table(scores: dict[Detector, Score]) -> list[str]:
    """The figures as a table of the page."""
    lines = ["| | pictures | fully visible | found | read right | false |", "|---|---:|---:|---:|---:|---:|"]
    for detector, s in scores.items():
        read = "" if detector is Detector.LIGHTS else f"{s.right} ({_part(s.right, s.found)})"
        found = f"{s.found} ({_part(s.found, s.whole)})"
        lines.append(f"| {detector} | {s.pictures} | {s.whole} | {found} | {read} | {s.false} |")
    return lines


def _part(some: int, of: int) -> str:
    return f"{some / of:.3f}" if of else "-"


def failures(scores: dict[Detector, Score]) -> list[str]:
    """What went wrong, a line each."""
    lines: list[str] = []
    for detector, s in scores.items():
        lines += [f"- {detector}: missed in {name}" for name in s.missed]
        lines += [f"- {detector}: {name}" for name in s.wrong]
        lines += [f"- {detector}: found where there is none in {name}" for name in s.invented]
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tools.second_renderer.measure")
    parser.add_argument("folder", type=Path, nargs="?", default=CORPUS, help="a set (default: the corpus)")
    arguments = parser.parse_args()
    if not (arguments.folder / "truth.json").is_file():
        parser.error(f"`{arguments.folder}` has no truth.json; expected a set of pictures")
    looked_at = list(pictures(arguments.folder))
    scores = {detector: score(detector, looked_at) for detector in Detector}
    lines = [*table(scores), "", *(failures(scores) or ["Nothing went wrong."])]
    print("\n".join(lines))


if __name__ == "__main__":
    main()
