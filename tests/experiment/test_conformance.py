"""What runs in the loop of experiments runs alike among the real servers."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.library import camera, data, proximity, robot
from tests.experiment.conformance_stage import CAMERA, Log, among_servers, frame_of, in_loop

FRAMES = 160


def _scripts(logs: Mapping[str, Log]) -> Mapping[str, Script]:
    return {
        "driver": _driver(logs["driver"]),
        "listener": _listener(logs["listener"]),
        "looker": _looker(logs["looker"]),
    }


def _driver(log: Log) -> Script:
    """Drives, corrects its position, hands goals to the listener, and reads what the network sets."""
    for name, value in (("$Goal", 0), ("$Done", 0)):
        log.append((name, (yield from do("DServer", data.create_semaphore(name, value)))))
    yield from do("DServer", data.set_many({"Wanted": 300, "Turning": 5.5}))
    for goal in range(6):
        now_ns = yield from sleep(0.45)
        where = yield from do("RServer", robot.position())
        log.append((frame_of(now_ns), where.x, where.y, where.heading, frame_of(where.t_ns)))
        yield from do("RServer", robot.adjust_position(7.0, -3.0 * goal, 0.25))
        after = yield from do("RServer", robot.position())
        log.append((after.x, after.y, after.heading))
        yield from do("DServer", data.set("Goal", [goal, 0.5]))
        yield from do("DServer", data.set("Wanted", 300.0 - 20 * goal))
        yield from do("DServer", data.signal("$Goal"))
        yield from do("DServer", data.wait("$Done"))
        log.append((frame_of((yield from sleep(0))), (yield from do("DServer", data.get("Goal")))))
        told = yield from do("DServer", data.get_many(("Count", "Wanted", "Report")))
        log.append(tuple(told.items()))
    yield from do("RServer", robot.set_position(1.0, 2.0, 3.0))
    log.append(((yield from do("RServer", robot.position())).x,))
    log.append(((yield from do("DServer", data.get("Count", type=int))),))
    setting = yield from do("RServer", robot.speed_setting())
    log.append((setting, (yield from do("RServer", robot.bumper()))))


def _listener(log: Log) -> Script:
    """Waits with and without patience, and meets refusals of every kind."""
    for ask in (
        data.get("Nothing"),
        data.get_many(("Goal", "Nothing")),
        data.get("Goal", -1),
        data.signal("$Nothing"),
        data.set("", 1),
        camera.grab_rows(2, 5),
    ):
        server = CAMERA if ask.method == "grab_rows" else "DServer"
        try:
            yield from do(server, ask)
        except CallRefusedError as refused:
            log.append((refused.code, refused.message))
    for turn in range(5):
        yield from sleep(0.05)
        try:
            yield from do("DServer", data.wait("$Goal", timeout_s=[0, 0.3, None, 2.0, None][turn]))
        except CallRefusedError as refused:
            log.append((turn, refused.code, frame_of((yield from sleep(0)))))
            continue
        log.append((turn, frame_of((yield from sleep(0)))))
        yield from sleep(0.2)
        yield from do("DServer", data.signal("$Done"))


def _looker(log: Log) -> Script:
    """Reads rings and images."""
    size = yield from do(CAMERA, camera.size())
    log.append((size.height, size.width, size.channels))
    yield from sleep(0.1)
    yield from do(CAMERA, camera.set_period(0.3))
    yield from sleep(0.05)  # who looks at the very moment of an image gets that one or the one before
    while True:
        now_ns = yield from sleep(0.3)
        scan = yield from do("PServer", proximity.sonar())
        seen = yield from do("PServer", proximity.infrared())
        image = yield from do(CAMERA, camera.grab_rows(1, 1))
        log.append((frame_of(now_ns), scan.ranges, seen.seen, image.pixels, frame_of(image.t_ns)))


@pytest.mark.parametrize("order_seed", [1, 2, 3])
def test_loop_and_servers_do_the_same(order_seed: int) -> None:
    here: dict[str, Log] = {"driver": [], "listener": [], "looker": []}
    there: dict[str, Log] = {"driver": [], "listener": [], "looker": []}
    mine = in_loop(_scripts, here, FRAMES)
    real = among_servers(_scripts, there, FRAMES, order_seed)
    for name, log in here.items():
        assert [tuple(line) for line in log] == [tuple(line) for line in there[name]], name
        assert len(log) > 4, name
    assert len(mine) == FRAMES
    assert real == mine[: len(real)]
    assert len(real) > FRAMES - 3
