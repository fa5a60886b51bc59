"""`colony robot import ros2` over a fake rclpy: what it writes, and what it refuses."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.paths import ROOT

GRAPH = {
    "/cmd_vel": {"subscribers": [["base", "geometry_msgs/msg/Twist"]]},
    "/estop": {"publishers": [["panel", "std_msgs/msg/Bool"]]},
    "/chatter": {"publishers": [["talker", "std_msgs/msg/String"]]},
}


@pytest.fixture
def graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests" / "ros2" / "fake"))
    monkeypatch.setenv("FAKE_RCLPY", str(tmp_path))
    (tmp_path / "inbox").write_text(json.dumps({"topic": "/estop", "data": "0001000001"}))
    return tmp_path / "graph.json"


IMPORT = ("robot", "import", "ros2", "rover", "--python", sys.executable, "--seconds", "0.1")


def test_a_description_is_written_once(colony: Colony, graph: Path) -> None:
    graph.write_text(json.dumps(GRAPH))
    out = colony.output(*IMPORT, "--domain", "7")
    written = "wrote robots/rover/rover.colony and robots/rover/rover.toml"
    assert out.splitlines() == [
        f"{written}; try: colony robot check rover",
        "uses cmd_vel, estop",
        "does not use chatter (std_msgs/msg/String)",
    ]
    assert colony("robot", "check", "rover") == (0, "rover: ok\n", "")
    assert "domain = 7\n" in Path("robots/rover/rover.toml").read_text()
    assert "it exists already" in colony.refusal(*IMPORT)
    assert "try: colony robot check more/rover/rover.colony\n" in colony.output(*IMPORT, "-o", "more")
    assert not graph.with_name("log").exists()


def test_a_graph_without_a_robot_is_an_error(colony: Colony, graph: Path) -> None:
    graph.write_text(json.dumps({"/chatter": GRAPH["/chatter"]}))
    err = colony.refusal(*IMPORT, "--domain", "7", "--namespace", "one", code=1)
    assert err.startswith("error: no robot in domain 7, namespace one: found 1 topic")
    assert not Path("robots").exists()


@pytest.mark.parametrize("name", ["rome", "a-b", "not"])
def test_names_that_no_robot_can_have_are_refused(colony: Colony, name: str) -> None:
    assert "name" in colony.refusal("robot", "import", "ros2", name)
