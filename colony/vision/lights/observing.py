"""Observations of the ceiling for scripts: lights detected in scan lines of the cameras."""

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
from colony.vision.lights.ceiling_camera import CeilingCameraModel
from colony.vision.lights.scan_lines import SeenLight, ceiling_lights

_TRIES = 3

NO_ANSWER_ERRORS = (CallRefusedError, ConnectionLostError, ServerNotFoundError, CallTimeoutError)
"""Errors of a call to a server that does not answer; scripts repeat the call later."""


class CeilingObservation(NamedTuple):
    """The lights in an image that was taken at `t_ns` of the robot's time, best first."""

    t_ns: int
    lights: tuple[SeenLight, ...]


CeilingObserver = Callable[[float], Generator[Step, Any, tuple[CeilingObservation, ...]]]
"""Returns the observations of new images; its argument is the estimated tilt of the heading, in degrees."""


def ensure_period(names: Sequence[str], period_s: float) -> Generator[Step, Any, None]:
    """Make these cameras take an image at least every `period_s`. A camera that refuses is left alone."""
    for name in names:
        try:
            if (yield from do(name, camera.period())) > period_s * 1e9:
                yield from do(name, camera.set_period(period_s))
        except NO_ANSWER_ERRORS:
            continue


def ceiling_observer(names: Sequence[str], geometries: Sequence[CeilingCameraModel]) -> CeilingObserver:
    """Return an observer of these cameras, in their order; a camera that does not answer is skipped."""
    newest_ns = dict.fromkeys(names, -1)

    def observe(tilt_deg: float) -> Generator[Step, Any, tuple[CeilingObservation, ...]]:
        observations: list[CeilingObservation] = []
        for name, geometry in zip(names, geometries, strict=True):
            try:
                bands = yield from _scan(name, geometry)
            except NO_ANSWER_ERRORS:
                continue
            if bands and bands[0].t_ns != newest_ns[name]:
                newest_ns[name] = bands[0].t_ns
                lines = np.concatenate([_gray(band) for band in bands])
                observations.append(
                    CeilingObservation(bands[0].t_ns, ceiling_lights(lines, geometry, tilt_deg=tilt_deg))
                )
        return tuple(observations)

    return observe


def _scan(name: str, geometry: CeilingCameraModel) -> Generator[Step, Any, list[Image]]:
    """Return the scan lines of one image; none if new images kept arriving in between."""
    bands: list[Image] = []
    for row in geometry.scan_rows * _TRIES:
        band = yield from do(name, camera.grab_rows(row))
        bands = [kept for kept in bands if kept.t_ns == band.t_ns]
        bands = sorted([*bands, band], key=lambda band: band.first_row)
        if len({band.first_row for band in bands}) == len(geometry.scan_rows):
            return bands
    return []


def _gray(band: Image) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return the first channel of a band, as gray lines."""
    pixels = camera.array(band)
    return pixels if pixels.ndim == 2 else pixels[:, :, 0]
