"""The plant as a child process: `python -m colony.sim.plant.child SPEC`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from colony.files import read_file
from colony.runtime.assembly.processes.shutdown import (
    Shutdown,
    exit_if_out_of_resources,
    exit_with,
    make_printing_safe,
    on_parent_exit,
    on_signals,
)
from colony.runtime.assembly.processes.spec import SPEC_BYTES, decoded_server
from colony.runtime.transport.live.run_directory import LiveError, RobotDirectory
from colony.sim.world_spec import ViewDirection, WorldSpec

if TYPE_CHECKING:
    from colony.body.model import Body
    from colony.sim.cameras.camera import CameraConfig
    from colony.sim.cameras.ceiling import CeilingCameraConfig

SIMULATOR = "Simulator"
"""Name of the plant among the processes of a robot."""


class PlantSpec(msgspec.Struct, frozen=True, kw_only=True):
    """The specification of a plant: one robot in a simulated world.

    Attributes:
        robot: the name of the robot.
        folder: the robot's folder.
        world: the world, with a map.
        body: the file of the robot's body; None for that of RoME.
        servers: the servers whose devices are simulated, as `encoded_server` writes them.
    """

    robot: str
    folder: str
    world: WorldSpec
    body: str | None = None
    servers: tuple[msgspec.Raw, ...] = ()

    @property
    def socket(self) -> Path:
        """The path of the socket to which drivers attach."""
        return plant_socket(Path(self.folder))


def plant_socket(folder: Path) -> Path:
    """Return the socket of the plant in a robot's folder."""
    return folder / "plant"


class NoClearanceError(Exception):
    """The robot does not fit at its start on the map; the message is one line that begins with the file."""


def serve(
    spec: PlantSpec,
    shutdown: Shutdown,
    *,
    ready: Callable[[], None] = lambda: None,
    report: Callable[[str], None] = lambda text: None,
) -> None:
    """Simulate until shutdown; `ready` is called when drivers can attach.

    `report` is called with a message if the simulator is being compiled.

    Raises:
        LiveError: a plant of the robot is already running, or the folder cannot be used.
        DiagnosticError: the map, one that its elevators lead to, or the body is invalid.
        NoClearanceError: the robot does not fit at its start.
    """
    with RobotDirectory(Path(spec.folder), spec.robot).claim(SIMULATOR):
        from colony.nav.maps.building import load_building
        from colony.nav.maps.world_map import load_world, world_of
        from colony.sim.compiling import announcing_compilation

        with announcing_compilation(report):
            from colony.sim.config import config_of
            from colony.sim.plant.assembly import PlantOptions
            from colony.sim.plant.process import serve_plant

            cameras = {name: _camera(direction) for name, direction in spec.world.cameras.items()}
        map_path, floors = spec.world.map_path, spec.world.floors
        assert map_path is not None
        building = load_building(map_path) if floors else None
        world = load_world(map_path) if building is None else world_of(building.map_named(floors[0]))
        body = _body(spec)
        try:
            start = world.start(config_of(body).radius_mm, spec.world.start)
            options = PlantOptions(
                path=spec.socket,
                spec=spec.world,
                world=world,
                building=building,
                robots={spec.robot: start},
                cameras=cameras,
                body=body,
                servers=tuple(map(decoded_server, spec.servers)),
            )
            serve_plant(options, stop=lambda: bool(shutdown), ready=ready)
        except ValueError as problem:
            raise NoClearanceError(f"{map_path}: error: the robot cannot start there: {problem}") from None


def _body(spec: PlantSpec) -> Body:
    from colony.body.reader import read_body
    from colony.body.shipped import ROME, shipped_body
    from colony.text.diagnostics import DiagnosticError

    if spec.body is None:
        return shipped_body(ROME)
    found = read_body(Path(spec.body))
    if found.body is None:
        raise DiagnosticError(found.diagnostics)
    return found.body


def _camera(direction: ViewDirection) -> CameraConfig | CeilingCameraConfig:
    from colony.sim.cameras.camera import rome_camera
    from colony.sim.cameras.ceiling import rome_ceiling_camera

    return rome_ceiling_camera() if direction == "up" else replace(rome_camera(), yaw_deg=direction)


def main() -> None:
    """Run the process."""
    from colony.text.diagnostics import DiagnosticError

    make_printing_safe()
    shutdown = Shutdown()
    with on_signals(shutdown):
        on_parent_exit(shutdown)
        try:
            serve(
                msgspec.json.decode(read_file(sys.argv[1], SPEC_BYTES), type=PlantSpec),
                shutdown,
                report=print,
            )
        except (LiveError, NoClearanceError, DiagnosticError) as problem:
            exit_with(str(problem))
        except Exception as problem:
            exit_if_out_of_resources(problem)


if __name__ == "__main__":
    main()
