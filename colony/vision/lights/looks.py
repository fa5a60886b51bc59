"""What a script sees of the ceiling: scan lines of cameras, made into lights, and the child processes of
thesis section 5.6.

Each of several cameras may have a child of its own, a script that looks at it alone. A light may be seen by
two of them. So that it is told once, a child that goes from "no light" to "light" takes a token, if nobody
has it, and only then tells what it sees; going from "light" to "no light", it gives the token back. The token
is a semaphore, what is told a variable; if a child dies, DServer takes its token back.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import Any, NamedTuple

import numpy as np

from colony.runtime.kit.errors import CallRefused, ConnectionLost, ServerNotFound, TimedOut
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import camera, data
from colony.runtime.servers.images import Image
from colony.vision.lights.ceiling_camera import UPWARD, CeilingCamera
from colony.vision.lights.scan_lines import Light, ceiling_lights

LIGHT_TOKEN = "$LightToken"
"""Who has it may write LightSeen."""

LIGHT_SEEN = "LightSeen"
"""A list: the time of an image in nanoseconds, and the lights in it, as in `scan_lines.Light`."""

_TRIES = 3

SILENT = (CallRefused, ConnectionLost, ServerNotFound, TimedOut)
"""What a server that does not answer raises; to be asked again in the next look."""


class Look(NamedTuple):
    """The lights in an image that was taken at `t_ns` of the robot's time, best first."""

    t_ns: int
    lights: tuple[Light, ...]


Looker = Callable[[float], Generator[Step, Any, tuple[Look, ...]]]
"""Gives what there is to see, no image twice; its argument is the tilt of the heading, as far as known."""


def camera_child(name: str, geometry: CeilingCamera = UPWARD, *, period_s: float = 0.25) -> Script:
    """Tell the lights that one camera sees, while this child has the token.

    It does not know the robot's heading: a light that only one outer line sees is told as if the robot went
    straight along the corridor, which is 5 mm off for each degree that it does not.
    """
    yield from do("DServer", data.create_semaphore(LIGHT_TOKEN, 1))
    yield from hurry((name,), period_s)
    looks = cameras_looker((name,), (geometry,))
    holding = False
    while True:
        yield from sleep(period_s)
        for look in (yield from looks(0.0)):
            if look.lights and not holding:
                holding = yield from _token()
            if holding:
                yield from do("DServer", data.set(LIGHT_SEEN, [look.t_ns, *look.lights]))
            if holding and not look.lights:
                yield from do("DServer", data.signal(LIGHT_TOKEN))
                holding = False


def hurry(names: Sequence[str], period_s: float) -> Generator[Step, Any, None]:
    """Have these cameras take an image every `period_s` at least. One that does not let us is let be."""
    for name in names:
        try:
            if (yield from do(name, camera.period())) > period_s * 1e9:
                yield from do(name, camera.set_period(period_s))
        except SILENT:
            continue


def cameras_looker(names: Sequence[str], geometries: Sequence[CeilingCamera]) -> Looker:
    """Looks at these cameras, one after the other. A camera that does not answer shows nothing."""
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


def children_looker() -> Looker:
    """Looks at what the child with the token tells."""
    newest = -1

    def look(tilt_deg: float) -> Generator[Step, Any, tuple[Look, ...]]:
        nonlocal newest
        try:
            told = yield from do("DServer", data.get(LIGHT_SEEN, type=list[Any]))
        except CallRefused:  # no child told anything yet
            return ()
        t_ns, lights = told[0], tuple(Light(*light) for light in told[1:])
        if t_ns == newest:
            return ()
        newest = t_ns
        return (Look(t_ns, lights),)

    return look


def _token() -> Generator[Step, Any, bool]:
    try:
        yield from do("DServer", data.wait(LIGHT_TOKEN, timeout_s=0.0, hold=True))
    except CallRefused:
        return False
    return True


def _scan(name: str, geometry: CeilingCamera) -> Generator[Step, Any, list[Image]]:
    """The scan lines of one image; empty where the camera was too fast for that, several times in a row."""
    bands: list[Image] = []
    for row in geometry.scan_rows * _TRIES:
        band = yield from do(name, camera.grab_rows(row))
        bands = [kept for kept in bands if kept.t_ns == band.t_ns]
        bands = sorted([*bands, band], key=lambda band: band.first_row)
        if len({band.first_row for band in bands}) == len(geometry.scan_rows):
            return bands
    return []


def _gray(band: Image) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """A band as lines of gray: the first channel, where there are several."""
    pixels = camera.array(band)
    return pixels if pixels.ndim == 2 else pixels[:, :, 0]
