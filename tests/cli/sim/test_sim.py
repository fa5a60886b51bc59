"""`colony sim snapshot`: what it writes, what it says, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from colony.nav.maps.signs import viewpoint_of
from colony.sim.cameras.snapshot import snapshot
from colony.sim.hazards.hazards import Hazards, draw
from tests.buildings import MSU
from tests.cli.conftest import Colony
from tests.paths import MAPS
from tests.sim.robots import FRONT_CAMERA

MAP = MAPS / "msu_engineering_3.stickrep"


def read(path: Path) -> NDArray[np.uint8]:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return np.asarray(image, dtype=np.uint8)


def test_it_writes_what_each_camera_sees(colony: Colony, tmp_path: Path) -> None:
    colony.output("sim", "snapshot", MAP, "--at", "376", "--hazards", "7")
    side = read(tmp_path / "side.png")
    scenery = draw(Hazards(), MSU, 7)
    expected = snapshot(
        MSU, viewpoint_of(MSU, "376"), replace(FRONT_CAMERA, yaw_deg=90.0), scenery=scenery, seed=7
    )
    assert np.array_equal(side, expected)
    assert read(tmp_path / "front.png").shape == (120, 240)
    assert read(tmp_path / "up.png").shape == (120, 240)


def test_an_elevator_is_seen_by_the_camera_ahead(colony: Colony, tmp_path: Path) -> None:
    out = colony.output(
        "sim", "snapshot", MAP, "--at", "acs.elev.L", "--size", "640x480", "-o", "shots", "--speed", "300"
    )
    assert "front.png: marker 000 of acs.elev.L, columns 225 to 414" in out
    assert read(tmp_path / "shots" / "front.png").shape == (480, 640)


def test_it_looks_where_it_is_told(colony: Colony) -> None:
    assert "heading 30 degrees" in colony("sim", "snapshot", MAP, "--at", "376", "--facing", "30").out
    out = colony("sim", "snapshot", MAP, "--at", "122170,20206,0").out
    assert "side.png: plate 381, columns 46 to 86, 1.89 m away" in out
    out = colony("sim", "snapshot", MAP, "--at", "122170,20206,180").out
    assert "front.png: neither plate nor marker" in out


@pytest.mark.parametrize(
    ("options", "found"),
    [
        (("--at", "9999"), "has no door or node `9999`"),
        (("--at", "1,2,x"), "expected a door, a node or X,Y,HEADING"),
        (("--at", "376", "--size", "9x9"), "expected WIDTHxHEIGHT"),
        (("--at", "376", "--size", "240"), "expected WIDTHxHEIGHT"),
        (("--at", "376", "--facing", "west"), "expected `plate`, or degrees"),
        (("--at", "376", "--facing", "nan"), "expected `plate`, or degrees"),
        (("--at", "1,2,3", "--facing", "90"), "`1,2,3` has a heading already; leave out --facing"),
        (("--at", "376", "--speed", "nan"), "`nan`; expected a speed from -5000 to 5000 mm/s"),
        (("--at", "376", "--speed", "1e300"), "expected a speed from -5000 to 5000 mm/s"),
        (("--at", "376", "-o", "/dev/null/shots"), "/dev/null/shots: error: cannot write: Not a directory"),
        ((), "Missing option '--at'"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(colony: Colony, options: tuple[str, ...], found: str) -> None:
    assert found in colony.refusal("sim", "snapshot", MAP, *options)


def test_a_map_that_is_not_there(colony: Colony) -> None:
    assert "cannot read the map" in colony.refusal("sim", "snapshot", "nowhere.stickrep", "--at", "1")


def test_alone_it_asks_for_a_command(colony: Colony) -> None:
    assert colony("sim") == (2, "", "colony sim: error: Missing command (see `colony sim --help`)\n")
