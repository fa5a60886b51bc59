"""`colony watch` of a robot that runs, by users of a gateway: what they see, and what they may stop."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect

from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.library import robot
from tests.cli.machine import MAP, ROBOT, WANDER, Machine, Started, failed, release
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.waiting import until
from tests.watch.runs import Page, page
from tests.watch.test_foxglove import Client

pytestmark = pytest.mark.long


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    machine = Machine(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    yield machine
    machine.close()


@pytest.fixture
def driving(machine: Machine) -> Machine:
    run = machine.start("run", WANDER, "--map", MAP, "--processes", "--no-picture", "--duration", "1000")
    until(lambda: failed(run) or machine.moves(), "the robot drives")
    return machine


def credentials(authority: Authority, name: str, folder: Path) -> Path:
    """Write the file of a user's credentials."""
    made = authority.user(name)
    path = folder / f"{name}.toml"
    lines = {"user": name, "certificate": made.certificate, "key": made.key, "authority": made.authority}
    path.write_text("".join(f'{key} = "{value}"\n' for key, value in lines.items()))
    return path


@contextmanager
def opened(watcher: Started) -> Iterator[Page]:
    until(lambda: failed(watcher) or "http" in watcher.out, "the page is served")
    host, token = watcher.out.split()[-1].removeprefix("http://").split("/#")
    with page(host, token=token) as shown:
        yield shown


def test_users_of_a_gateway_have_their_rights(driving: Machine, tmp_path: Path) -> None:
    certificates = tmp_path / "certificates"
    certificates.mkdir()
    authority, endpoint = Authority(certificates), f"tls/localhost:{free_port()}"
    table = authority.table({"bob": ("read",), "dora": ("read", "stop")})
    driving.serve("Gateway", "--robot", ROBOT, "--listen", endpoint, "--security", str(table))
    for name, may_stop in (("bob", False), ("dora", True)):
        file = credentials(authority, name, certificates)
        options = ("--connect", endpoint, "--security", str(file), "--allow-stop", "--port", "0")
        with opened(driving.start("watch", "--robot", ROBOT, *options)) as shown:
            found = shown.until(lambda m: m.get("snapshot", {}).get("is_known"))["snapshot"]
            assert found["commands"][0]["is_decided"]
            shown.ask(do="ask", module="cruise", k=found["k"])
            assert shown.until(lambda m: "answer" in m)["answer"]["lines"]
            shown.ask(do="stop")
            assert shown.until(lambda m: "stop" in m)["stop"]["is_kept"] is may_stop
            if may_stop:
                until(driving.stands, "the robot stands")
                shown.until(lambda m: m.get("snapshot", {}).get("stopped_by") is not None)
            else:
                until(driving.moves, "the robot drives on")


def shown_scene(watcher: Started) -> dict[str, Any]:
    """Return the scene of a page that is opened now."""
    with opened(watcher) as shown:
        scene = shown.until(lambda m: "scene" in m)["scene"]
        assert isinstance(scene, dict)
        return scene


def is_sensed(snapshot: dict[str, Any], scene: dict[str, Any]) -> bool:
    """Whether the sonars of a frame have readings, and the command of the base is known."""
    sonar = [sensor["name"] for sensor in scene["sensors"]].index("sonar")
    return bool(snapshot and snapshot["sensors"][sonar] and snapshot["commands"][0]["is_decided"])


def test_a_robot_is_watched_before_a_program_after_it_and_restarted(machine: Machine) -> None:
    serve = ("serve", "all", "--robot", f"{ROBOT}=rome", "--map", MAP)
    servers = machine.start(*serve)
    until(lambda: servers.ended() or machine.stands(), "the robot is there")
    watcher = machine.start("watch", "--robot", ROBOT, "--allow-stop", "--port", "0")
    with opened(watcher) as shown:
        scene = shown.until(lambda m: "scene" in m)["scene"]
        assert scene["is_idle"]
        assert scene["modules"] == []
        shown.until(lambda m: is_sensed(m.get("snapshot", {}), scene))
        with machine.session() as session, session.connect("RServer", name="test", priority=5) as base:
            moving = base.send(robot.move(1000.0))
            shown.until(lambda m: "snapshot" in m and m["snapshot"]["commands"][0]["outside"])
            shown.ask(do="stop")
            assert shown.until(lambda m: "stop" in m)["stop"]["is_kept"]
            with pytest.raises(CallRefusedError):
                moving.result()
            shown.until(lambda m: m.get("snapshot", {}).get("stopped_by") is not None)
            release(session)
    run = machine.start("drive", WANDER, "--robot", ROBOT)
    until(lambda: failed(run) or "cruise" in shown_scene(watcher)["modules"], "the program is shown")
    assert run.interrupt() == 130
    until(lambda: shown_scene(watcher)["is_idle"], "the robot is shown without it")

    assert servers.interrupt() == 0
    with opened(watcher) as shown:
        shown.until(lambda m: (m.get("problem") or "").startswith("no frames come from rome"))
        servers = machine.start(*serve)
        scene = shown_scene(watcher)
        shown.until(lambda m: m.get("problem", "?") is None and is_sensed(m.get("snapshot", {}), scene))
    assert scene["is_idle"]
    assert not servers.ended(), servers.err
    assert not watcher.ended(), watcher.err


def test_a_robot_whose_description_is_not_known_is_not_watched_without_a_program(machine: Machine) -> None:
    servers = machine.start("serve", "all", "--robot", f"{ROBOT}=create2", "--map", MAP)
    until(lambda: servers.ended() or machine.stands(), "the robot is there")
    watcher = machine.start("watch", "--robot", f"{ROBOT}=amr", "--port", "0")
    assert watcher.wait() == 2
    assert "its description is `create2`, not `amr`" in watcher.err
    named = machine.start("watch", "--robot", ROBOT, "--port", "0")
    scene = shown_scene(named)
    assert (scene["robot"], scene["description"]) == (ROBOT, "create2"), "as the robot says"


def test_a_page_says_why_nothing_moves(machine: Machine, tmp_path: Path) -> None:
    behavior = tmp_path / "stand.colony"
    stand = "module stand { when true do drive(velocity = 0, turn = 0) }"
    behavior.write_text(f"language 1\nimport robot\n{stand}\nnetwork {{ drive = stand }}\n")
    run = machine.start("run", str(behavior), "--robot", ROBOT, "--map", MAP, "--processes", "--no-picture")
    until(lambda: failed(run) or machine.stands(), "the robot is there")
    with opened(machine.start("watch", "--robot", ROBOT, "--port", "0")) as shown:
        troubles = shown.until(lambda m: m.get("seen", {}).get("troubles"))["seen"]["troubles"]
    assert troubles == ["nothing moves: `stand` commands it to stand, or a limit holds it at 0"]


def test_a_robot_is_shown_in_foxglove_and_so_is_its_next_program(machine: Machine) -> None:
    pytest.importorskip("foxglove", reason="needs foxglove-sdk")
    servers = machine.start("serve", "all", "--robot", f"{ROBOT}=rome", "--map", MAP)
    until(lambda: servers.ended() or machine.stands(), "the robot is there")
    watcher = machine.start("watch", "--robot", ROBOT, "--port", "0", "--foxglove", "0")
    until(lambda: failed(watcher) or "ws://" in watcher.out, "Foxglove is served")
    url = watcher.out.split()[-1]
    with connect(url, subprotocols=["foxglove.sdk.v1"], proxy=None) as socket:  # type: ignore[list-item]
        client = Client(socket)
        assert "/actuators/drive" in {c["topic"] for c in client.subscribe()}
        while client.message()[0] != "/scans/sonar":
            pass
        run = machine.start("drive", WANDER, "--robot", ROBOT)
        offered = set[str]()
        while "/modules" not in offered:
            offered |= {c["topic"] for c in client.subscribe()}
        while client.message()[0] != "/modules":
            pass
    assert run.interrupt() == 130
    assert watcher.interrupt() == 0
