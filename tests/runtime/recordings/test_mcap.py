"""Recordings as MCAP: the `mcap` package reads what is written, whenever the writer was killed."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace
from typing import Any

import pytest
from mcap.reader import make_reader

from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Request
from colony.runtime.recordings.mcap_writer import checksum
from colony.text.diagnostics import DiagnosticError
from tests.analysis.recorded_runs import MS, as_mcap, logs, read_mcap, run_info
from tests.runtime.recordings.mcap_files import (
    PROGRAM,
    SOURCES,
    TEXT,
    frames_in,
    trace,
)


def messages(data: bytes) -> dict[str, list[dict[str, Any]]]:
    """What the package's own reader finds, by topic."""
    out: dict[str, list[dict[str, Any]]] = {}
    for _, channel, message in make_reader(io.BytesIO(data)).iter_messages(log_time_order=False):
        out.setdefault(channel.topic, []).append(json.loads(message.data))
    return out


def test_what_other_tools_find() -> None:
    data = as_mcap(PROGRAM, logs(PROGRAM, trace()), *SOURCES).content
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None
    assert sum(map(len, messages(data).values())) == 6 * 3 + 1 + 1
    topics = {c.topic for c in summary.channels.values()}
    assert topics == {
        "/frames",
        "/keyframes",
        "/contracts",
        *(f"/{x}/{a}" for x in ("verdicts", "requests") for a in ("drive", "lamp")),
    }
    found = {m.name: m.metadata for m in reader.iter_metadata()}
    assert found["colony"] == {
        "format": "colony-recording/2",
        "semantics": "4",
        "version": "1.2.3",
        "robot": "rome",
        "program": "b.colony",
        "frame_ns": "50000000",
        "seed": "7",
        "run": "",
        "started": "",
        "checksum": checksum(found["colony"]),
    }
    assert found["colony clients of drive"] == {"back": "2", "cruise": "1", "checksum": "7794a62e"}
    attachments = {a.name: (a.media_type, a.data) for a in reader.iter_attachments()}
    assert attachments == {
        "python/pkg/mod.py": ("text/x-python", b"x = 1\n"),
        "behavior/b.colony": ("text/x-colony", TEXT.encode()),
    }


def test_messages() -> None:
    right = logs(PROGRAM, trace())
    requests = (
        Request(k=1, actuator="drive", client="back", bid="silent"),
        Request(k=1, actuator="drive", client="cruise", bid="command", values=(100.0, 0.0)),
        Request(k=1, actuator="drive", client="cruise", bid="silent"),
        Request(k=1, actuator="lamp", client="shine", bid="command", fault="not finite"),
    )
    right[1] = replace(right[1], requests=requests)
    right[2] = replace(right[2], restart=True)
    right[3] = replace(right[3], memory_unknown=True, breaches=())
    found = messages(as_mcap(PROGRAM, right).content)
    assert found["/frames"][1] == {
        "k": 1,
        "t": 0.05,
        "t_ns": 50 * MS,
        "start": 0,
        "sensors": {"near": 100.0, "rays": [0.1, -0.0, 1e-300], "bumper": False},
    }
    assert found["/frames"][2]["restart"] is True
    assert [f.get("skipped") for f in found["/frames"]] == [None] * 3 + [0] + [None] * 2
    values = {"velocity": 100.0, "turn": 0.0}
    assert found["/verdicts/drive"][1] == {
        "k": 1,
        "by": "cruise",
        "values": values,
        "fates": {"cruise": "won", "back": "inactive"},
    }
    assert found["/verdicts/lamp"][1] == {"k": 1, "fates": {"shine": "inactive"}}
    assert found["/requests/drive"] == [
        {"k": 1, "clients": {"back": {"bid": "silent"}, "cruise": {"bid": "command", "values": values}}}
    ]
    assert found["/requests/lamp"] == [
        {"k": 1, "clients": {"shine": {"bid": "command", "fault": "not finite"}}}
    ]
    assert found["/contracts"] == [{"k": 4, "broken": ["slow"]}]


SIMPLE = {"boolean": (bool,), "string": (str,), "number": (int, float), "integer": (int,)}


def conforms(value: object, schema: dict[str, Any]) -> None:
    """What tools that draw recordings can read: every schema has one type, and values are of it."""
    kind = schema["type"]
    assert "description" in schema or kind in SIMPLE
    if kind == "object":
        assert isinstance(value, dict)
        assert set(schema.get("required", ())) <= set(value)
        assert set(value) <= set(schema["properties"]) or schema.get("additionalProperties")
        for name, of in schema["properties"].items():
            conforms(value[name], of) if name in value else well_formed(of)
    elif kind == "array":
        assert isinstance(value, list)
        for element in value:
            conforms(element, schema["items"])
    else:
        assert isinstance(value, SIMPLE[kind])
        assert isinstance(value, bool) is (kind == "boolean")


def well_formed(schema: dict[str, Any]) -> None:
    assert isinstance(schema["type"], str)
    for of in schema.get("properties", {}).values():
        well_formed(of)
    assert (schema["type"] == "object") == ("properties" in schema)
    if schema["type"] == "array":
        well_formed(schema["items"])


def test_messages_are_as_their_schemas_say() -> None:
    right = logs(PROGRAM, trace(), restarts=[3])
    bid = Request(k=0, actuator="drive", client="cruise", bid="command", values=(100.0, 0.0))
    right[0] = replace(right[0], requests=(bid,), disagreements=("x",))
    checked = 0
    for schema, channel, message in make_reader(io.BytesIO(as_mcap(PROGRAM, right).content)).iter_messages():
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        well_formed(json.loads(schema.data))
        conforms(json.loads(message.data), json.loads(schema.data))
        checked += 1
    assert checked == 6 * 3 + 1 + 1 + 2


def same(found: RunFrame | Any, right: RunFrame) -> None:
    assert (found.tick, found.restart, found.breaches) == (right.tick, right.restart, right.breaches)
    assert found.frame.t_ns == right.frame.t_ns
    assert dict(found.verdicts) == dict(right.verdicts)


def test_what_is_read_back() -> None:
    right = logs(PROGRAM, trace(), restarts=[3])
    found, reader = read_mcap(PROGRAM, as_mcap(PROGRAM, right, *SOURCES).content)
    assert reader.truncation is None
    assert reader.run == run_info(PROGRAM, *SOURCES)
    assert len(found) == len(right)
    for one, log in zip(found, right, strict=True):
        same(one, log)
        assert list(one.frame.readings["rays"]) == list(log.frame.readings["rays"])  # type: ignore[arg-type]
        assert math.copysign(1, one.frame.readings["rays"][1]) == -1  # type: ignore[index]


def test_odd_readings_and_times() -> None:
    frames = (
        Frame(-5, {"near": math.inf, "bumper": 3}),
        Frame(1 << 62, {"near": 10**400, "rays": (math.nan,) * 3}),
    )
    found, _ = read_mcap(PROGRAM, as_mcap(PROGRAM, logs(PROGRAM, frames)).content)
    assert [f.frame.t_ns for f in found] == [-5, 1 << 62]
    assert found[0].frame.readings == {"near": math.inf, "bumper": 3}
    assert found[1].frame.readings == {"near": math.inf, "rays": ["nan"] * 3}


def test_a_chunk_of_less_than_half_a_second_leaves_in_one_write() -> None:
    file = as_mcap(PROGRAM, logs(PROGRAM, trace(20)), *SOURCES)
    assert [frames_in(data) for data in file.writes] == [0, 8, 8, 4, 0]
    assert file.closed


def test_long_frames_are_chunks_of_their_own() -> None:
    slow = load_text(TEXT.replace("robot rome {", "robot rome {\n  frame 300 ms"))
    frames = tuple(Frame(k * 300 * MS, {"near": 1.0}) for k in range(4))
    assert [frames_in(data) for data in as_mcap(slow, logs(slow, frames)).writes] == [0, 1, 1, 1, 1, 0]


def test_of_another_robot() -> None:
    data = as_mcap(PROGRAM, logs(PROGRAM, trace())).content
    for old, new in (("lamp", "light"), ("velocity", "speed")):
        with pytest.raises(DiagnosticError) as caught:
            read_mcap(load_text(TEXT.replace(old, new)), data)
        assert caught.value.diagnostics[0].code == "A004"
