"""The preparation of a camera that looks along the floor."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from colony.runtime.kit.script import Step, do
from colony.runtime.library import camera
from colony.vision.level_camera import LevelCamera
from colony.vision.lights.looks import SILENT, hurry


def made_ready(name: str, geometry: LevelCamera, period_s: float) -> Generator[Step, Any, bool]:
    """Make a camera take an image at least every `period_s`; False if it does not answer.

    Repeat this if the camera was away or had no new image after a period: it may have restarted.

    Raises:
        ValueError: its images are not as large as `geometry` says, and so would be misunderstood.
    """
    yield from hurry((name,), period_s)
    try:
        size = yield from do(name, camera.size())
    except SILENT:
        return False
    if (size.width, size.height) != (geometry.columns, geometry.rows):
        found = f"{name} gives images of {size.width} x {size.height} pixels"
        raise ValueError(
            f"{found}; expected {geometry.columns} x {geometry.rows}: tell the finder its `geometry`"
        )
    return True
