"""The plant as a process: real sockets, real time, and what it must survive."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
from dataclasses import replace
from pathlib import Path

import pytest

from colony.body.model import ServerTable
from colony.body.servers import servers_of
from colony.body.shipped import shipped_body
from colony.ir.servers import FieldSpec, ServerSpec
from colony.ir.types import DIMENSIONLESS
from colony.nav.maps.free_space import FreeSpace
from colony.nav.maps.world_map import load_world, world_of
from colony.sim.hazards.hazards import Hazards
from colony.sim.plant.assembly import PlantOptions, populated_scenery
from colony.sim.plant.control import PlantControl
from colony.sim.plant.process import serve_plant
from colony.sim.plant.protocol import (
    MAX_BYTES_FROM_PLANT,
    MAX_BYTES_TO_PLANT,
    VERSION,
    Attach,
    AttachBase,
    AttachCamera,
    AttachControl,
    Attached,
    AttachProximity,
    BaseReading,
    CameraReading,
    DriveBase,
    FromPlant,
    ProximityReading,
    Refusal,
    Truth,
    pack,
    read_from_plant,
)
from colony.sim.plant.servers import RemoteDevice
from colony.sim.world.movers import movers
from colony.sim.world_spec import WorldSpec
from tests.buildings import HALLWAY
from tests.paths import MAPS
from tests.sim.plant.plants import OTHER, START, PlantProcess, controlled, wait_for
from tests.waiting import PATIENCE_S


class Line:
    """A raw connection to the plant."""

    def __init__(self, path: Path, *said: bytes) -> None:
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.sock.settimeout(PATIENCE_S)
        self.sock.connect(os.fspath(path))
        for packet in said:
            self.sock.send(packet)

    def hear(self) -> FromPlant | None:
        """The next message; None at the end."""
        try:
            packet = self.sock.recv(MAX_BYTES_FROM_PLANT)
        except ConnectionResetError:
            packet = self.sock.recv(MAX_BYTES_FROM_PLANT)
        return read_from_plant(packet) if packet else None

    def refusal(self) -> str:
        """Wait until it is refused, which ends it; return why."""
        while not isinstance(heard := self.hear(), Refusal):
            assert heard is not None
        self.close()
        return heard.message

    def close(self) -> None:
        self.sock.close()


def standing(control: PlantControl, robot: str) -> Truth:
    """What is true of a robot once it stands and nobody commands it."""

    def truth() -> Truth | None:
        found = control.truth(robot)
        return found if found.velocity == 0.0 and not found.driven else None

    return wait_for(truth)


@pytest.mark.parametrize(
    ("attach", "kind"),
    [
        (AttachBase(robot="rome"), BaseReading),
        (AttachProximity(robot="rome"), ProximityReading),
        (AttachCamera(robot="rome", camera="left"), CameraReading),
    ],
)
def test_devices_report_by_themselves_in_time(
    plant: PlantProcess, control: PlantControl, attach: Attach, kind: type[BaseReading]
) -> None:
    line = Line(plant.path, pack(attach))
    assert is_attached(line.hear())
    times = []
    for _ in range(4):
        reading = line.hear()
        assert isinstance(reading, kind)
        times.append(reading.t_ns)
    assert times == sorted(set(times))
    line.close()


def test_a_base_that_is_commanded_once_stops_after_the_watchdog_s_time(
    plant: PlantProcess, control: PlantControl
) -> None:
    before = control.truth("rome")
    line = Line(plant.path, pack(AttachBase(robot="rome")), pack(DriveBase(velocity=300.0, turn=0.0)))
    wait_for(lambda: control.truth("rome").velocity > 0.0)
    way = standing(control, "rome").distance - before.distance
    assert 0.0 < way < 300.0 * 0.5 + 300.0**2 / (2 * 800.0)  # the time is the plant's own
    line.close()


def test_a_base_whose_connection_ends_stops(plant: PlantProcess, control: PlantControl) -> None:
    line = Line(plant.path, pack(AttachBase(robot="rome")))
    drive = pack(DriveBase(velocity=300.0, turn=0.0))

    def moves() -> bool:
        line.sock.send(drive)
        return control.truth("rome").velocity > 0.0

    wait_for(moves)
    line.close()
    assert not wait_for(lambda: None if control.truth("rome").driven else control.truth("rome")).driven
    standing(control, "rome")


def test_who_does_not_drive_loses_the_base_to_the_next(plant: PlantProcess, control: PlantControl) -> None:
    first = Line(plant.path, pack(AttachBase(robot="rome")))
    assert is_attached(first.hear())
    second = Line(plant.path, pack(AttachBase(robot="rome")))
    assert is_attached(second.hear())
    while first.hear() is not None:
        pass
    other = Line(plant.path, pack(AttachBase(robot="remus")))
    assert is_attached(other.hear())
    assert isinstance(second.hear(), BaseReading)
    for line in (first, second, other):
        line.close()


def test_who_drives_keeps_the_base(plant: PlantProcess, control: PlantControl) -> None:
    def refused() -> Refusal | None:
        """Once the second comes before the watchdog does."""
        first = Line(plant.path, pack(AttachBase(robot="rome")), pack(DriveBase(velocity=1.0, turn=0.0)))
        assert is_attached(first.hear())
        assert first.hear() is not None
        second = Line(plant.path, pack(AttachBase(robot="rome")))
        heard = second.hear()
        first.close()
        second.close()
        return heard if isinstance(heard, Refusal) else None

    assert wait_for(refused).message == "another driver is in command of the base"


@pytest.mark.parametrize(
    ("said", "found"),
    [
        ([b"\x63"], "found version 99"),
        ([bytes([VERSION]) + b"\xc1\xc1"], "malformed"),
        ([pack(AttachBase(robot="r" * MAX_BYTES_TO_PLANT))], "truncated"),
        ([pack(DriveBase(velocity=1.0, turn=0.0))], "DriveBase is not allowed on this connection"),
        ([pack(AttachBase(robot="bob"))], "no robot `bob`; the robots are rome, remus"),
        ([pack(AttachCamera(robot="rome", camera="up"))], "no camera `up`; they have ahead, left"),
        ([pack(AttachControl()), pack(AttachControl())], "AttachControl is not allowed on this connection"),
        (
            [pack(AttachProximity(robot="rome")), pack(DriveBase(velocity=1.0, turn=0.0))],
            "DriveBase is not allowed",
        ),
        (
            [pack(AttachBase(robot="rome")), pack(DriveBase(velocity=float("nan"), turn=0.0))],
            "expected finite",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(
    plant: PlantProcess, control: PlantControl, said: list[bytes], found: str
) -> None:
    refusal = Line(plant.path, *said).refusal()
    assert found in refusal.lower() or found in refusal
    assert control.truth("rome").velocity == 0.0


def test_noise_from_many_sides_holds_nobody_up(plant: PlantProcess, control: PlantControl) -> None:
    print("seed 11")
    rng = random.Random(11)
    watched = Line(plant.path, pack(AttachProximity(robot="rome")))
    for _ in range(100):
        line = Line(plant.path, *([pack(AttachBase(robot="rome"))] if rng.random() < 0.3 else ()))
        with contextlib.suppress(BrokenPipeError):  # it may be ended before all was said
            line.sock.send(rng.randbytes(rng.randrange(200)))
        line.close()
    assert isinstance(watched.hear(), Attached)
    assert isinstance(watched.hear(), ProximityReading)
    assert standing(control, "rome").distance >= 0.0
    watched.close()


def test_a_reader_that_does_not_read_holds_nobody_up(plant: PlantProcess, control: PlantControl) -> None:
    deaf = Line(plant.path, pack(AttachCamera(robot="rome", camera="ahead")))
    greedy = Line(plant.path, pack(AttachControl()))
    with pytest.raises((BrokenPipeError, ConnectionResetError)):  # it takes no answers: it is ended
        ask_and_never_listen(greedy)
    start = control.truth("rome").t_ns
    wait_for(lambda: control.truth("rome").t_ns > start + 500_000_000)
    assert isinstance(deaf.hear(), Attached)
    assert isinstance(deaf.hear(), CameraReading)
    deaf.close()
    greedy.close()


def ask_and_never_listen(line: Line) -> None:
    for _ in range(100_000):
        line.sock.send(pack(AttachControl()))


def test_control_says_what_is_wrong_and_goes_on(plant: PlantProcess, control: PlantControl) -> None:
    with pytest.raises(ValueError, match="no robot `bob`"):
        control.truth("bob")
    with pytest.raises(ValueError, match=r"robot 1 at .* overlaps robot 0"):
        control.place("rome", OTHER[0] + 100.0, OTHER[1], 0.0)
    control.place("rome", 6000.0, 1500.0, 90.0)
    truth = control.truth("rome")
    assert (truth.x, truth.y, truth.heading) == (6000.0, 1500.0, 90.0)


def test_a_plant_that_was_frozen_goes_on_in_the_present(plant: PlantProcess, control: PlantControl) -> None:
    before = control.truth("rome")
    plant.process.send_signal(signal.SIGSTOP)
    wait_for(lambda: is_frozen(plant.process.pid))
    plant.process.send_signal(signal.SIGCONT)
    after = wait_for(lambda: t if (t := control.truth("rome")).t_ns > before.t_ns else None)
    assert (after.x, after.y) == (before.x, before.y)


def is_attached(heard: FromPlant | None) -> bool:
    return isinstance(heard, Attached) and heard.began_ns > 0


def is_frozen(pid: int) -> bool:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"


# --- starting and ending -------------------------------------------------------------------------


def options(path: Path, **changed: object) -> PlantOptions:
    given: dict[str, object] = {"path": path, "world": world_of(HALLWAY), "robots": {"rome": START}} | changed
    return PlantOptions(**given)  # type: ignore[arg-type]


def test_people_who_walk_around_join_those_of_the_hazards(tmp_path: Path) -> None:
    loop, office = load_world(MAPS / "loop.stickrep"), load_world(MAPS / "office.yaml")
    for world in (loop, office):
        robots = {"rome": tuple(world.start(400.0))}
        alone = populated_scenery(options(tmp_path, world=world, robots=robots))
        few = populated_scenery(
            options(tmp_path, world=world, robots=robots, spec=WorldSpec(movers=3, seed=4))
        )
        assert alone.people == ()
        assert few.people == movers(FreeSpace(world), world.start(400.0)[:2], 3, seed=4)
    hazards = Hazards(person_spacing_mm=5_000.0)
    robots = {"rome": tuple(loop.start(400.0))}
    many = [
        populated_scenery(
            options(tmp_path, world=loop, robots=robots, hazards=hazards, spec=WorldSpec(movers=n))
        ).people
        for n in (0, 2)
    ]
    assert len(many[0]) > 0
    assert many[1][:-2] == many[0]


def test_a_socket_left_behind_is_replaced(tmp_path: Path) -> None:
    left = tmp_path / "left"
    with socket.socket(socket.AF_UNIX) as old:
        old.bind(os.fspath(left))
    turns = iter((False, False, True))
    told: list[bool] = []
    serve_plant(options(left), stop=lambda: next(turns), ready=lambda: told.append(left.is_socket()))
    assert told == [True]
    assert not left.exists()


def test_options_that_make_no_sense(tmp_path: Path) -> None:
    for changed, found in (
        ({"robots": {"rome": (0.0, 0.0, 0.0)}}, "from a wall"),
        ({"robots": {}}, "expected"),
        ({"step_ns": 0}, "steps of 0 ns"),
    ):
        with pytest.raises(ValueError, match=found):
            serve_plant(options(tmp_path / "never", **changed), stop=lambda: True)
    assert not (tmp_path / "never").exists()


def test_a_plant_has_the_devices_and_fields_of_its_servers_alone(tmp_path: Path) -> None:
    body = shipped_body("amr")
    probe = ServerSpec(
        "Probe", fields=(FieldSpec("moisture", DIMENSIONLESS, "the value that the interface declares"),)
    )
    body = replace(body, servers={**body.servers, "Probe": ServerTable()})
    servers = (*(spec for spec in servers_of(body) if spec.name not in ("Panel", "Probe")), probe)
    amr = options(tmp_path / "plant", robots={"amr": START}, body=body, servers=servers)
    with controlled(amr) as control, contextlib.closing(RemoteDevice(amr.path, "amr", "Probe")) as probe:
        with pytest.raises(ValueError, match="no device of `Panel`; it has"):
            control.give("amr", "Panel", "estop", True)
        assert wait_for(probe.fields) == {"moisture": None}
        control.give("amr", "Probe", "moisture", 0.5)
        wait_for(lambda: (reading := probe.fields()["moisture"]) is not None and reading.value == 0.5)
