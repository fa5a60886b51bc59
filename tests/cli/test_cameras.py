"""`--camera`: which servers there are, where each looks, and what the one that looks up sees."""

from __future__ import annotations

import pytest

from colony.cli.run.options import OptionError, cameras
from colony.runtime.kit.connection import Connection
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.library import camera
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, ROBOT, Machine, failed
from tests.waiting import until


@pytest.mark.parametrize(
    ("texts", "looking"),
    [
        ((), {}),
        (("90",), {"CServer": 90.0}),
        (("up",), {"CServer": "up"}),
        (("left=90", "CServerUp=up"), {"CServer_left": 90.0, "CServerUp": "up"}),
        (("roof=up", "0.5 rad"), {"CServer_roof": "up", "CServer": pytest.approx(28.648, abs=1e-3)}),
    ],
)
def test_a_camera_has_a_server_and_a_direction(texts: tuple[str, ...], looking: dict[str, object]) -> None:
    assert cameras(texts) == looking


@pytest.mark.parametrize("text", ["down", "left=", "=up", "a b=up", "up=", "361", "90 mm", "CServer Up=up"])
def test_what_is_no_camera_is_refused(text: str) -> None:
    with pytest.raises(OptionError, match=f"found `{text}`; expected degrees, `up`, or a name"):
        cameras((text,))


@pytest.mark.parametrize("texts", [("up", "90"), ("a=up", "a=9"), ("CServerUp=up", "CServerUp=0")])
def test_two_cameras_have_two_names(texts: tuple[str, ...]) -> None:
    with pytest.raises(OptionError, match="two "):
        cameras(texts)


def test_hazards_are_of_the_building(colony: Colony) -> None:
    err = colony.refusal("serve", "PServer", "--robot", "r", "--hazards", "1")
    assert "--hazards requires Simulator or all, which simulate the building; found PServer" in err


@pytest.mark.long
def test_a_server_shows_the_ceiling_above_the_robot(machine: Machine) -> None:
    options = ("--robot", ROBOT, "--map", MAP, "--camera", "CServerUp=up", "--hazards", "3")
    served = machine.start("serve", "all", *options)
    until(lambda: failed(served) or "CServerUp" in machine.directory.running(), "the camera's server runs")
    with machine.session() as session, session.connect("CServerUp", name="test", priority=1) as connection:
        until(lambda: _has_an_image(connection), "there is an image")
        size = connection.do(camera.size())
        assert (size.height, size.width, size.channels) == (120, 240, 1)
        row = camera.array(connection.do(camera.grab_rows(60)))
        assert row.shape == (1, 240)
        assert 20.0 < row.mean() < 250.0
        assert row.std() > 1.0


def _has_an_image(connection: Connection) -> bool:
    try:
        connection.do(camera.grab())
    except CallRefusedError:
        return False
    return True
