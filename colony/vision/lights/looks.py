"""Observations of the ceiling for a script: scan lines of cameras, turned into lights."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import Any, NamedTuple

import numpy as np

from colony.runtime.kit.errors import (
    CallRefusedError,
    CallTimeoutError,
    ConnectionLostError,
    ServerNotFoundError,
)
from colony.runtime.kit.script import Step, do
from colony.runtime.library import camera
from colony.runtime.protocol.images import Image
from colony.vision.lights.ceiling_camera import CeilingCamera
from colony.vision.lights.scan_lines import Light, ceiling_lights

_TRIES = 3

SILENT = (CallRefusedError, ConnectionLostError, ServerNotFoundError, CallTimeoutError)
"""Errors of a server that does not answer; the next look asks it again."""


class Look(NamedTuple):
    """The lights in an image that was taken at `t_ns` of the robot's time, best first."""

    t_ns: int
    lights: tuple[Light, ...]


Looker = Callable[[float], Generator[Step, Any, tuple[Look, ...]]]
"""Gives what there is to see, no image twice; its argument is the tilt of the heading, as far as known."""


def hurry(names: Sequence[str], period_s: float) -> Generator[Step, Any, None]:
    """Make these cameras take an image at least every `period_s`. A camera that refuses is left alone."""
    for name in names:
        try:
            if (yield from do(name, camera.period())) > period_s * 1e9:
                yield from do(name, camera.set_period(period_s))
        except SILENT:
            continue


def cameras_looker(names: Sequence[str], geometries: Sequence[CeilingCamera]) -> Looker:
    """Return a function that looks at these cameras in turn. A silent camera shows nothing."""
    newest = dict.fromkeys(names, -1)

    def look(tilt_deg: float) -> Generator[Step, Any, tuple[Look, ...]]:
        looks: list[Look] = []
        for name, geometry in zip(names, geometries, strict=True):
            try:
                bands = yield from _scan(name, geometry)
            except SILENT:
                continue
            if bands and bands[0].t_ns != newest[name]:
                newest[name] = bands[0].t_ns
                lines = np.concatenate([_gray(band) for band in bands])
                looks.append(Look(bands[0].t_ns, ceiling_lights(lines, geometry, tilt_deg=tilt_deg)))
        return tuple(looks)

    return look


def _scan(name: str, geometry: CeilingCamera) -> Generator[Step, Any, list[Image]]:
    """Return the scan lines of one image; empty if the camera was too fast, several times in a row."""
    bands: list[Image] = []
    for row in geometry.scan_rows * _TRIES:
        band = yield from do(name, camera.grab_rows(row))
        bands = [kept for kept in bands if kept.t_ns == band.t_ns]
        bands = sorted([*bands, band], key=lambda band: band.first_row)
        if len({band.first_row for band in bands}) == len(geometry.scan_rows):
            return bands
    return []


def _gray(band: Image) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return a band as lines of gray: the first channel, where there are several."""
    pixels = camera.array(band)
    return pixels if pixels.ndim == 2 else pixels[:, :, 0]
