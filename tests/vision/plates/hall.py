"""A robot that drives past a wall with plates on its left, and its servers: for tests of the plate finder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.geometry import Point
from colony.runtime.assembly.loop import LocalCamera
from colony.runtime.kit.script import Script
from colony.runtime.library import proximity, robot
from colony.runtime.protocol.calls import CallId, Handler, RefusedError
from colony.runtime.protocol.images import Image
from colony.vision.level_camera import SIDE
from studies.thesis.wall_view import WallView
from tests.kit.script_stage import FRAME_NS, ScriptStage, Server, Shutter
from tests.vision.plates.walls import Board, wall_image


@dataclass(frozen=True, slots=True, kw_only=True)
class Hall:
    """A wall in the west, what is on it (`place_mm` is how far north), and a robot that goes north beside it
    from `start_mm` on. `off_mm` is how far its odometry is off, east and north; its heading is `tilt_deg`
    off the hallway's; `sonar_mm` is what sonar 18 reads, by the wall unless given; between the times of
    `silent_s` no server but DServer answers."""

    boards: Sequence[Board]
    wall_mm: float = 1500.0
    start_mm: float = -1800.0
    speed_mm_s: float = 500.0
    tilt_deg: float = 0.0
    off_mm: tuple[float, float] = (0.0, 0.0)
    sonar_mm: float | None = None
    silent_s: tuple[float, float] = (math.inf, math.inf)


def known(hall: Hall) -> tuple[Plate, ...]:
    """The plates of a hall as the map has them."""
    return tuple(
        Plate(
            edge=0, start_mm=0.0, end_mm=356.0, center=Point(-hall.wall_mm, board.place_mm), heading_deg=90.0,
            door=board.text[0], text=board.text[0],
        )
        for board in hall.boards
    )  # fmt: skip


class Stage(ScriptStage):
    """Scripts beside the robot. Mutable: the time, and with it the robot's place; what was asked of the
    camera."""

    def __init__(self, hall: Hall, **scripts: Script) -> None:
        self._hall = hall
        self.camera = LocalCamera("CServerSide", Shutter(lambda: self._image(self.now_ns)))
        self.asked: list[str] = []
        self.camera.handlers = {
            name: self._counted(name, handler) for name, handler in self.camera.handlers.items()
        }
        base = Server("RServer", {"position": self._position})
        ring = Server("PServer", {"sonar": self._sonar})
        super().__init__(scripts, base, ring, cameras=[self.camera])

    def run(self, seconds: float) -> None:
        """Let so much time pass."""
        for _ in range(round(seconds * 1e9 / FRAME_NS)):
            self.settle()
            self.now_ns += FRAME_NS

    def place(self, t_ns: int) -> float:
        """Where the robot is along the hall."""
        return self._hall.start_mm + self._hall.speed_mm_s * t_ns / 1e9

    def _counted(self, name: str, handler: Handler) -> Handler:
        def counted(asked: CallId, arguments: Any, now_ns: int) -> object:
            self.asked.append(name)
            self._answers(now_ns)
            return handler(asked, arguments, now_ns)

        return counted

    def _answers(self, now_ns: int) -> None:
        low, high = self._hall.silent_s
        if low <= now_ns / 1e9 < high:
            raise RefusedError("no value", "the device does not answer")

    def _position(self, asked: CallId, arguments: Any, now_ns: int) -> robot.Position:
        self._answers(now_ns)
        east, north = self._hall.off_mm
        heading = self._hall.tilt_deg % 360.0
        return robot.Position(x=east, y=self.place(now_ns) + north, heading=heading, t_ns=now_ns)

    def _sonar(self, asked: CallId, arguments: Any, now_ns: int) -> proximity.SonarReading:
        self._answers(now_ns)
        ranges = [10_000.0] * 24
        ranges[18] = self._hall.wall_mm - 360.0 if self._hall.sonar_mm is None else self._hall.sonar_mm
        return proximity.SonarReading(t_ns=now_ns, ranges=tuple(ranges))

    def _image(self, now_ns: int) -> Image:
        """Places on the wall count to the left: backward."""
        here = self.place(now_ns)
        boards = [replace(board, place_mm=here - board.place_mm) for board in self._hall.boards]
        near = [board for board in boards if abs(board.place_mm) < 3000.0]
        view = WallView(self._hall.wall_mm, self._hall.tilt_deg)
        pixels = wall_image(near, view, SIDE, seed=now_ns % 1_000_003)
        return Image(t_ns=now_ns, height=SIDE.rows, width=SIDE.columns, channels=1, pixels=pixels.tobytes())
