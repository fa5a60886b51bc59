"""`colony run` in an occupancy grid, and where a robot starts in it or in a building."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Colony
from tests.nav.maps.grid.small_grids import written

RUN = ("run", "wander", "--robot", "amr", "--map", "office", "--duration", "2")


def test_a_robot_drives_in_a_grid_and_its_path_is_drawn(colony: Colony, tmp_path: Path) -> None:
    assert json.loads(colony.output(*RUN, "--format", "json"))["distance_mm"] > 200.0
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def test_a_run_off_the_map_says_when_it_left(colony: Colony, tmp_path: Path) -> None:
    shades = np.full((60, 60), 205, dtype=np.uint8)
    shades[10:50, 10:50] = 254
    path = written(tmp_path, shades, origin="[-1.0, -1.0, 0.0]")
    command = ("run", "wander", "--robot", "amr", "--map", path, "--no-picture", "--duration", "8")
    code, out, err = colony(*command)
    assert code == 0
    assert "no cell is occupied: the image has the shades 205 and 254" in err
    [line] = [line for line in out.splitlines() if "left the known" in line]
    known, image, off = map(float, re.findall(r"[0-9.]+(?= s)", line))
    assert 0.0 < known < image < 8.0
    assert off == pytest.approx(7.95 - known, abs=0.01)
    summary = json.loads(colony(*command, "--format", "json").out)["off_map"]
    assert [round(summary[key], 2) for key in ("left_known_s", "left_image_s", "seconds")] == [
        known,
        image,
        off,
    ]


def test_a_start_from_where_a_robot_gets_nowhere_is_reported(colony: Colony, tmp_path: Path) -> None:
    shades = np.full((80, 120), 254, dtype=np.uint8)
    shades[:, 24:30] = shades[:50, :24] = 0
    path = written(tmp_path, shades, origin="[0.0, 0.0, 0.0]")
    command = ("run", "wander", "--robot", "amr", "--map", path, "--no-picture", "--duration", "0.1")
    assert "of the free cells" not in colony(*command).err
    code, _, err = colony(*command, "--start", "600,700,0")
    assert code == 0
    assert "can get from (0.60 m, 0.70 m) to 7.9 % of the free cells" in err
    assert json.loads(colony("map", path, "--no-picture", "--format", "json").out)["reachable"] > 0.85
    security = ("--listen", "tls/localhost:0", "--security", "/dev/zero")  # which is refused afterwards
    served = colony("serve", "all", "--robot", "amr", "--map", path, "--start", "600,700,0", *security)
    assert served.code == 2
    assert "can get from (0.60 m, 0.70 m) to 7.9 % of the free cells" in served.err


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--start", "1,2"), "--start: found `1,2`; expected X,Y,HEADING, in mm and degrees"),
        (("--start", "1,2 deg,3"), "--start: found `1,2 deg,3`; expected X,Y,HEADING"),
        (("--start", "1,2,nan"), "--start: found `1,2,nan`; expected X,Y,HEADING"),
        (("--start", "1e300,2,3"), "--start: found `1e300,2,3`; expected X,Y,HEADING"),
        (
            ("--start", "-3m,0,0"),
            "is 0 mm from a wall or from cells that are unknown; expected at least 400 mm",
        ),
        (("--from", "a", "--to", "b", "--start", "0,0,0"), "--to excludes --start"),
        (("--processes", "--camera", "0"), "a camera requires a building; found an occupancy grid"),
    ],
)
def test_what_a_grid_refuses(colony: Colony, more: tuple[str, ...], said: str) -> None:
    assert said in colony.one_line(*RUN, *more)


def test_routes_require_a_building(colony: Colony) -> None:
    err = colony.refusal("run", "navigator", "--map", "office", "--from", "a", "--to", "b")
    assert "error[M037]: expected a building; found an occupancy grid" in err


def test_a_start_in_a_building(colony: Colony) -> None:
    code, _, err = colony("run", "wander", "--map", "loop", "--duration", "1", "--start", "1m,1m,0")
    assert code == 0
    for outside in ("-50m,-50m,0", "5m,5m,0"):
        code, _, err = colony("run", "wander", "--map", "loop", "--duration", "1", "--start", outside)
        assert code == 2
        assert "is not in free space" in err
    err = colony.refusal("run", "wander", "--map", "loop", "--duration", "1", "--start", "0,0,0")
    assert "the robot cannot start there: robot 0 at (0, 0) is 0 mm from a wall" in err


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("all", "--hazards", "1"), "--hazards requires a building; found an occupancy grid"),
        (("all", "--camera", "up"), "a camera requires a building; found an occupancy grid"),
        (("Simulator", "--camera", "up"), "a camera requires a building; found an occupancy grid"),
        (("Simulator", "--start", "-3m,0,0"), "the robot cannot start there: (-3000, 0) is 0 mm"),
        (("RServer", "--start", "0,0,0"), "--start requires Simulator or all"),
    ],
)
def test_what_serving_in_a_grid_refuses(colony: Colony, more: tuple[str, ...], said: str) -> None:
    assert said in colony.refusal("serve", *more, "--robot", "amr", "--map", "office")


@pytest.mark.parametrize(
    ("other", "code", "said"),
    [
        ("omni:nosuch", 2, "colony run: error: --also omni:nosuch: cannot use `nosuch` for this robot:"),
        (
            "omni:navigator",
            1,
            "colony run: error: --also omni:navigator: cannot use `navigator` for this robot:",
        ),
        (
            "a=omni:wander@-50m,0,0",
            2,
            "--also a: error: it cannot start there: (-50000, 0) is 0 mm from a wall",
        ),
    ],
)
def test_errors_of_other_robots_name_them(colony: Colony, other: str, code: int, said: str) -> None:
    result = colony(*RUN, "--also", other)
    assert result.code == code
    assert result.err.splitlines()[0].startswith(said)


def test_a_robot_that_mujoco_cannot_simulate_is_refused_before_its_map_is_read(colony: Colony) -> None:
    run = ("run", "wander", "--map", "no_such_map", "--physics", "mujoco", "--duration", "1")
    err = colony.refusal(*run, "--robot", "omni")
    assert "error: `omni` cannot be simulated: MuJoCo simulates two driven wheels" in err
    assert "no_such_map" not in err
