"""Messages for Foxglove, read by others: by `mcap`, by Foxglove's protobuf types, by a WebSocket client."""

from __future__ import annotations

import io
import json
import math
import struct
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from typing import Any

import pytest
from mcap.reader import make_reader
from websockets.sync.client import ClientConnection, connect

from colony.analysis.follower import Interpreters, ProgramExecutors, step_given
from colony.dsl.load import load_file, load_text
from colony.ir.frame import given_in_frame
from colony.watch.foxglove.layout import layout_of
from colony.watch.foxglove.messages import RunMessages
from colony.watch.foxglove.shapes import ScanShape, grid_of, zones_of
from colony.watch.foxglove.sinks import FoxgloveServer, write_mcap
from colony.watch.scene import MapScene, PageScene
from tests.paths import ROOT
from tests.waiting import until
from tests.watch.runs import FRAMES, PROGRAM, TEXT, run, scene

WATCHING = TEXT.replace("when ranges[0 deg] < 2 m", "when min(ranges[-90 deg .. 90 deg]) < 2 m")

COUNTED = load_text(WATCHING + "contract counts: bumps < 5")  # without it, nothing reads the state

FOOTPRINT = ((200.0, 100.0), (-200.0, 100.0), (-200.0, -100.0), (200.0, -100.0))
WALLS = MapScene(name="m", walls=((0.0, 0.0, 1000.0, 0.0), (0.0, 0.0, 0.0, 500.0)), holes=())


def shown() -> PageScene:
    return replace(scene(program=COUNTED), footprint_mm=FOOTPRINT, map=WALLS)


def written(frames: Any = None) -> bytes:
    file = io.BytesIO()
    count = write_mcap(file, RunMessages(COUNTED, shown()), run() if frames is None else frames, "colony")
    assert count == FRAMES
    return file.getvalue()


class Read:
    """The messages of a file: their times in ms and contents by topic, and the schema of each topic."""

    def __init__(self, content: bytes) -> None:
        self.messages: dict[str, list[tuple[int, Any]]] = {}
        self.schemas: dict[str, Any] = {}
        for schema, channel, message in make_reader(io.BytesIO(content)).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            self.schemas[channel.topic] = schema
            found = (message.log_time // 1_000_000, json.loads(message.data))
            self.messages.setdefault(channel.topic, []).append(found)

    def at(self, topic: str, ms: int) -> Any:
        """Return the message of a topic that is current at a time."""
        return [content for t, content in self.messages[topic] if t <= ms][-1]


@pytest.fixture(scope="module")
def file() -> Read:
    return Read(written())


def test_all_that_foxglove_draws_is_of_its_types(file: Read) -> None:
    pytest.importorskip("foxglove_schemas_protobuf", reason="needs foxglove-schemas-protobuf")
    from google.protobuf.json_format import ParseDict

    drawn = {topic: s.name for topic, s in file.schemas.items() if s.name.startswith("foxglove.")}
    assert " ".join(sorted(drawn)) == "/footprint /log /map /path /pose /scans/ranges /tf /zones"
    for topic, full_name in drawn.items():
        name = full_name.removeprefix("foxglove.")
        type_ = getattr(import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)
        for _, content in file.messages[topic]:
            read = ParseDict(_with_protobuf_times(content), type_())  # refuses members that it does not know
            assert read.ByteSize() > 0


def _with_protobuf_times(content: Any) -> Any:
    """Return a message with times and durations as protobuf writes them in JSON; ours are objects."""
    if isinstance(content, list):
        return [_with_protobuf_times(x) for x in content]
    if not isinstance(content, dict):
        return content
    found = {name: _with_protobuf_times(x) for name, x in content.items()}
    if "timestamp" in content:
        t = content["timestamp"]
        found["timestamp"] = f"1970-01-01T00:00:{t['sec']:02}.{t['nsec']:09}Z"
    if "lifetime" in content:
        found["lifetime"] = f"{content['lifetime']['sec']}s"
    return found


def test_scans_begin_at_the_lowest_bearing_and_leave_out_what_is_out_of_range(file: Read) -> None:
    found = file.at("/scans/ranges", 0)  # elements look along -90, 0, 90 and 180 degrees
    assert found["ranges"] == [1.0, 0.0, 3.0, 0.0]  # from -180 degrees; 4 m are as far as it sees
    assert (round(found["start_angle"], 4), round(found["end_angle"], 4)) == (-3.1416, 1.5708)
    assert [t for t, _ in file.messages["/scans/ranges"]] == [0, 300, 500, 1200, 1300]  # those that are new


@pytest.mark.parametrize(
    ("bearings", "beams", "size"),
    [
        ((-90.0, -50.0, 50.0, 90.0), [0, 2, 7, 9], 10),
        ((0.0, -0.1, 90.0), [1, 0, 901], 902),
        (tuple(i * 2 / 3 - 90 for i in range(271)), list(range(271)), 271),
        ((10.0,), [0], 1),
    ],
)
def test_a_scan_has_a_beam_for_each_bearing(bearings: tuple[float, ...], beams: list[int], size: int) -> None:
    shape = ScanShape(replace(scene().sensors[0], bearings=bearings))
    ranges = shape.message(0, shape.in_range([1.0 + i / 1000 for i in range(len(bearings))]))["ranges"]
    assert (shape.beams, len(ranges)) == (beams, size)
    assert [ranges[b] for b in beams] == [1.0 + i / 1000 for i in range(len(bearings))]
    assert sum(x > 0 for x in ranges) == len(bearings)


def test_poses_have_x_ahead(file: Read) -> None:
    pose, tf = file.at("/pose", 1900)["pose"], file.at("/tf", 1900)
    assert pose["position"] == {"x": 1.9, "y": 0.0, "z": 0.0} == tf["translation"]
    assert abs(pose["orientation"]["w"]) == 1.0  # heading 270 is east: no turn
    assert (tf["parent_frame_id"], tf["child_frame_id"]) == ("map", "base")
    [line] = file.at("/path", 1900)["entities"][0]["lines"]
    assert [p["x"] for p in line["points"]] == [0.0, 1.0]


def test_actuators_have_winners_values_and_bounds(file: Read) -> None:
    assert file.at("/actuators/drive", 0) == {
        "by": "cruise",
        "velocity": 400.0,
        "velocity_low": -400.0,
        "velocity_high": 400.0,
        "turn": 0.0,
        "turn_low": -90.0,
        "turn_high": 90.0,
    }
    near = file.at("/actuators/drive", 1200)
    assert (near["velocity"], near["velocity_high"]) == (300.0, 300.0)
    assert file.at("/actuators/drive", 800)["by"] == "nobody"
    assert file.at("/sensors", 1500)["bump"] is True
    assert file.at("/modules", 300)["avoid"] == "won"
    assert [c for _, c in file.messages["/states"]] == [{"bumps": 0.0}, {"bumps": 1.0}]
    assert file.at("/contracts", 1500) == {
        "slow_when_near": True,
        "never_backward": False,
        "counts": True,
    }


def test_the_log_has_what_begins_and_why(file: Read) -> None:
    log = [(t, m["level"], m["name"], m["message"]) for t, m in file.messages["/log"]]
    assert [(t, level, name, text.splitlines()[0]) for t, level, name, text in log] == [
        (0, 2, "drive", "nobody -> cruise"),
        (300, 2, "drive", "cruise -> avoid"),
        (500, 2, "drive", "avoid -> nobody"),
        (800, 3, "drive/cruise", "late"),
        (900, 2, "drive", "nobody -> cruise"),
        (1500, 2, "drive", "cruise -> back_off"),
        (
            *(1500, 4, "contract never_backward"),
            "broken: `drive.velocity >= 0 mm/s` fails by 100 mm/s: -100 mm/s against 0 mm/s "
            "(drive is by back_off)",
        ),
    ]
    assert "`ranges[0 deg] < 1 m` holds by 500 mm: 500 mm against 1000 mm" in log[1][3]


def test_zones_reach_to_what_is_nearest_and_show_what_is_in_force() -> None:
    messages = RunMessages(COUNTED, shown())
    zones = [
        json.loads(m.data)["entities"][0]["lines"][0]
        for f in run()[:5]
        for m in list(messages.take(f))
        if m.topic == "/zones"
    ]
    assert [[p["y"] for p in zone["points"]] for zone in zones] == [
        [0.0, -3.0, 0.0, 3.0],
        [0.0, -3.0, 0.0, 3.0],
        [0.0, -0.5, 0.0, 0.5],
    ]
    assert zones[0]["color"] == zones[1]["color"] != zones[2]["color"]
    assert zones_of(PROGRAM, [scene().sensors[0]]) == ()


def test_limits_of_robots_are_found_through_values() -> None:
    program = load_file(str(ROOT / "behaviors" / "warehouse.colony"))
    ranges = scene(program=program).sensors[0]
    spans = {(z.limit.relation, z.angles[0], z.angles[-1]) for z in zones_of(program, [ranges])}
    assert {("<=", -75.0, 75.0), (">=", 105.0, -105.0)} <= spans


def test_a_map_is_a_grid_of_walls(file: Read) -> None:
    grid = file.at("/map", 0)
    cells, columns = b64decode(grid["data"]), grid["column_count"]
    assert (columns, len(cells), grid["cell_size"]) == (21, 21 * 11, {"x": 0.05, "y": 0.05})
    assert cells[:columns] == bytes([100] * columns)
    assert all(cells[row * columns] == 100 for row in range(11))
    assert sum(cells) == 100 * (21 + 10)
    far = replace(WALLS, walls=((0.0, 0.0, 1e6, 0.0), (0.0, 0.0, 0.0, 1e6)))
    assert len(b64decode(grid_of(far, 0)["data"])) < 4_000_000


def test_the_same_run_gives_the_same_bytes() -> None:
    assert written() == written()


def test_frames_without_memory_have_what_was_observed() -> None:
    read = Read(written([replace(f, memory_unknown=True, breaches=None) for f in run()]))
    assert "velocity_high" not in read.at("/actuators/drive", 1200)
    assert "/contracts" not in read.messages
    assert len(read.messages["/tf"]) == FRAMES
    assert read.at("/log", 300)["message"] == "cruise -> avoid"


@pytest.mark.parametrize("faulty", ["east", None, math.nan, math.inf, True, ("x",) * 4, (math.nan,) * 4, ()])
def test_faulty_readings_are_left_out(faulty: Any) -> None:
    readings = dict.fromkeys((s.name for s in PROGRAM.robot.sensors), faulty)
    frames = [
        f if k != 3 else replace(f, frame=f.frame._replace(readings=readings)) for k, f in enumerate(run())
    ]
    read = Read(written(frames))
    for topic, found in read.messages.items():
        assert "null" not in json.dumps(found), topic
        assert "NaN" not in json.dumps(found), topic
    assert 300 not in dict(read.messages["/tf"])


def test_bounds_are_the_interpreters() -> None:
    executor, interpreter = ProgramExecutors(PROGRAM).begin(), Interpreters(PROGRAM).begin()
    [drive] = PROGRAM.robot.actuators
    for frame in run():
        step_given(interpreter, frame)
        executor.step(frame.frame, {}, given_in_frame([drive], frame.verdicts))
        found = executor.bounds()["drive"]
        assert tuple(zip(found.low, found.high, strict=True)) == interpreter.bounds(drive)


def test_a_layout_shows_the_topics() -> None:
    topics = [c.topic for c in RunMessages(COUNTED, shown()).channels]
    layout = layout_of(shown(), topics)
    panels, work = [], [layout["layout"]]
    while work:
        node = work.pop()
        if isinstance(node, str):
            panels.append(node)
        else:
            work += [node["first"], node["second"]]
    assert sorted(panels) == sorted(layout["configById"])
    assert sorted(p.partition("!")[0] for p in panels) == ["3D", "Plot", "RosOut", "StateTransitions"]
    paths = [p["value"] for c in layout["configById"].values() for p in c.get("paths", ())]
    assert "/actuators/drive.velocity_high" in paths
    assert {path.partition(".")[0] for path in paths} <= set(topics)
    assert set(layout["configById"]["3D!colony"]["topics"]) <= set(topics)


# --- live ----------------------------------------------------------------------------------------------


@pytest.fixture
def server() -> Iterator[FoxgloveServer]:
    pytest.importorskip("foxglove", reason="needs foxglove-sdk")
    made = FoxgloveServer(0)
    yield made
    made.close()


class Client:
    """A client of the protocol `foxglove.sdk.v1`. Mutable."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self._topics = socket, dict[int, str]()
        assert socket.subprotocol == "foxglove.sdk.v1"
        assert self.text("serverInfo")["capabilities"] == []

    def text(self, operation: str) -> Any:
        """Return the next message in JSON with this operation."""
        while True:
            data = self._socket.recv(timeout=60)
            if isinstance(data, str) and (found := json.loads(data))["op"] == operation:
                return found

    def subscribe(self) -> list[Any]:
        """Subscribe to all topics that are offered next; return them."""
        channels: list[Any] = self.text("advertise")["channels"]
        self._topics |= {c["id"]: c["topic"] for c in channels}
        wanted = [{"id": c["id"], "channelId": c["id"]} for c in channels]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        return channels

    def message(self) -> tuple[str, int, Any]:
        """Return the next message of a topic: the topic, its time in ns, and its content."""
        while True:
            data = self._socket.recv(timeout=60)
            if isinstance(data, bytes) and data[0] == 1:
                subscription, t_ns = struct.unpack_from("<IQ", data, 1)
                return self._topics[subscription], t_ns, json.loads(data[13:])


def test_a_live_run_is_heard_also_by_those_who_come_late(server: FoxgloveServer) -> None:
    frames = run()
    take = server.tap_for(COUNTED, shown())
    take(frames[0])
    with connect(server.url, subprotocols=["foxglove.sdk.v1"], proxy=None) as socket:  # type: ignore[list-item]
        client = Client(socket)
        channels = client.subscribe()
        expected = {c.topic: c.schema_name for c in RunMessages(COUNTED, shown()).channels}
        assert {c["topic"]: c["schemaName"] for c in channels} == expected
        until(lambda: server.has_newcomer, "the server knows of the subscriptions")
        for frame in frames[1:]:
            take(frame)
        heard: dict[str, tuple[int, Any]] = {}
        while heard.get("/tf", (0,))[0] < frames[-1].frame.t_ns or "/log" not in heard:
            topic, t_ns, content = client.message()
            heard[topic] = t_ns, content
        assert heard["/map"][1]["column_count"] == 21
        assert heard["/footprint"][0] == frames[1].frame.t_ns
        assert heard["/contracts"][1]["never_backward"] is False
        assert heard["/tf"][1]["translation"]["x"] == 1.9
        server.tap_for(load_text(TEXT), scene())
        assert len(client.text("unadvertise")["channelIds"]) > 0
        assert client.text("advertise")["channels"]


def test_a_taken_port_is_an_error(server: FoxgloveServer) -> None:
    with pytest.raises(RuntimeError):
        FoxgloveServer(int(server.url.rpartition(":")[2]))
