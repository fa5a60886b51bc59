"""The plant as a process that is started by another one: `python -m colony.sim.plant.child SPEC`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import msgspec

from colony.files import read_file
from colony.runtime.assembly.processes.ending import (
    Ending,
    drop_what_cannot_be_printed,
    give_up,
    give_up_without,
    on_death_of_parent,
    on_signals,
)
from colony.runtime.assembly.processes.spec import SPEC_BYTES
from colony.runtime.transport.live.errors import LiveError
from colony.runtime.transport.live.run_directory import RobotDirectory

if TYPE_CHECKING:
    from colony.sim.cameras.camera import CameraConfig
    from colony.sim.cameras.ceiling import CeilingCameraConfig

SIMULATOR = "Simulator"
"""Its name among the processes of a robot."""

Look = float | Literal["up"]
"""Direction of a camera: so many degrees counterclockwise from ahead, or at the ceiling."""


class PlantSpec(msgspec.Struct, frozen=True, kw_only=True):
    """The specification of a plant: one robot in the building of a map, with the direction of each camera.

    `start` is the robot's first pose, x and y in mm and its heading in degrees, None for the map's; `hazards`
    is the seed of the hazards (docs/hazards.md), None for none; `folder` is the robot's, `logical_ns` as in
    `colony.sim.plant.process.PlantOptions`.
    """

    robot: str
    folder: str
    map: str
    seed: int
    cameras: dict[str, Look] = {}
    start: tuple[float, float, float] | None = None
    hazards: int | None = None
    logical_ns: int | None = None

    @property
    def socket(self) -> Path:
        """Path of the socket to which drivers attach."""
        return plant_socket(Path(self.folder))


def plant_socket(folder: Path) -> Path:
    """Return the socket of the plant in a robot's folder."""
    return folder / "plant"


class NoRoomError(Exception):
    """The robot cannot start where the map says; the message is one line that begins with the file."""


def serve(
    spec: PlantSpec,
    ending: Ending,
    *,
    ready: Callable[[], None] = lambda: None,
    tell: Callable[[str], None] = lambda text: None,
) -> None:
    """Simulate until it is time to end; `ready` is called when drivers can attach.

    `tell` is called with a message for what takes long until then.

    Raises:
        LiveError: a plant of the robot runs already, or the folder cannot be used.
        DiagnosticError: the map is bad.
        NoRoomError: the robot has no room in it.
    """
    with RobotDirectory(Path(spec.folder), spec.robot).claim(SIMULATOR):
        from colony.nav.maps.stickrep.reader import load_map
        from colony.sim.compiling import told_when_compiling

        with told_when_compiling(tell):
            from colony.sim.hazards.hazards import Hazards
            from colony.sim.plant.process import PlantOptions, serve_plant

        building = load_map(spec.map)
        start = building.start
        options = PlantOptions(
            path=spec.socket,
            building=building,
            robots={spec.robot: spec.start or (start.x_mm, start.y_mm, start.heading_deg)},
            cameras={name: _camera(look) for name, look in spec.cameras.items()},
            hazards=Hazards.none() if spec.hazards is None else Hazards(),
            hazards_seed=spec.hazards or 0,
            seed=spec.seed,
            logical_ns=spec.logical_ns,
        )
        try:
            serve_plant(options, stop=lambda: bool(ending), ready=ready)
        except ValueError as problem:
            raise NoRoomError(f"{spec.map}: error: the robot cannot start there: {problem}") from None


def _camera(look: Look) -> CameraConfig | CeilingCameraConfig:
    from colony.sim.cameras.camera import CameraConfig
    from colony.sim.cameras.ceiling import CeilingCameraConfig

    return CeilingCameraConfig() if look == "up" else CameraConfig(yaw_deg=look)


def main() -> None:
    """Run the process."""
    from colony.text.diagnostics import DiagnosticError

    drop_what_cannot_be_printed()
    ending = Ending()
    with on_signals(ending):
        on_death_of_parent(ending)
        try:
            serve(msgspec.json.decode(read_file(sys.argv[1], SPEC_BYTES), type=PlantSpec), ending, tell=print)
        except (LiveError, NoRoomError, DiagnosticError) as problem:
            give_up(str(problem))
        except Exception as problem:
            give_up_without(problem)


if __name__ == "__main__":
    main()
