"""Sets up a level camera."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from colony.runtime.kit.script import Step, do
from colony.runtime.library import camera
from colony.vision.level_camera import LevelCamera
from colony.vision.lights.observing import NO_ANSWER_ERRORS, ensure_period


def prepare_camera(name: str, geometry: LevelCamera, period_s: float) -> Generator[Step, Any, bool]:
    """Make a camera take an image at least every `period_s`; return False if it does not answer.

    Call it again if the camera did not answer or had no new image after a period: it may have restarted.

    Raises:
        ValueError: the camera's images do not have the size given by `geometry`.
    """
    yield from ensure_period((name,), period_s)
    try:
        size = yield from do(name, camera.size())
    except NO_ANSWER_ERRORS:
        return False
    if (size.width, size.height) != (geometry.columns, geometry.rows):
        found = f"{name} gives images of {size.width} x {size.height} pixels"
        raise ValueError(
            f"{found}; expected {geometry.columns} x {geometry.rows}: pass the camera's `geometry`"
        )
    return True
