"""Bytes that others wrote or recorded mean here what their sources say; `vectors.toml` has them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from colony.drivers.create2.codec import (
    GROUPS,
    PACKETS,
    CommandReader,
    Opcode,
    command,
    data_of,
    decoder,
    drive,
    drive_direct,
    encoded,
    size_of,
    state_of,
    values_of,
)

VECTORS: list[dict[str, Any]] = tomllib.loads(Path(__file__).with_name("vectors.toml").read_text())["vector"]


def _id(vector: dict[str, Any]) -> str:
    return str(vector["bytes"])[:20]


def test_there_are_enough_of_them() -> None:
    keys = {(vector["bytes"], *vector.get("ids", ())) for vector in VECTORS}
    assert len(keys) == len(VECTORS) >= 20
    assert all(vector["origin"] for vector in VECTORS)


@pytest.mark.parametrize("vector", [v for v in VECTORS if "frame" in v], ids=_id)
def test_a_frame_of_others(vector: dict[str, Any]) -> None:
    data = bytes(map(int, vector["bytes"].split()))
    found = decoder(tuple(vector["ids"])).feed(data)
    if vector.get("rejected"):
        assert found == []
        return
    (frame,) = found
    assert frame.values() == vector["values"]
    assert encoded(frame) == data


@pytest.mark.parametrize("vector", [v for v in VECTORS if "ids" in v and "frame" not in v], ids=_id)
def test_packets_of_others(vector: dict[str, Any]) -> None:
    data = bytes(map(int, vector["bytes"].split()))
    values = values_of(tuple(vector["ids"]), data)
    assert values == vector["values"]
    assert data_of(tuple(vector["ids"]), values) == data
    state = state_of(values)
    for name, value in vector.get("state", {}).items():
        assert getattr(state, name) == (tuple(value) if isinstance(value, list) else value)


@pytest.mark.parametrize("vector", [v for v in VECTORS if "ids" not in v], ids=_id)
def test_a_command_of_others(vector: dict[str, Any]) -> None:
    data = bytes(map(int, vector["bytes"].split()))
    for name, function in (("drive", drive), ("drive_direct", drive_direct)):
        if name not in vector:
            continue
        if vector.get("rejected"):
            with pytest.raises(ValueError, match="at most 500"):
                function(*vector[name])
            return
        assert function(*vector[name]) == data
    if "command" in vector:
        assert command(Opcode(data[0]), *data[1:]) == data == bytes(vector["command"])
    for size in (1, 2, len(data)):  # in any pieces
        reader = CommandReader()
        found = [one for at in range(0, len(data), size) for one in reader.feed(data[at : at + size])]
        assert found == [(data[0], data[1:])]


def test_a_beep_that_several_programs_send_is_two_commands() -> None:
    assert CommandReader().feed(bytes([140, 3, 1, 64, 16, 141, 3])) == [
        (140, bytes([3, 1, 64, 16])),
        (141, bytes([3])),
    ]


def test_sizes_of_groups_are_those_of_the_specification() -> None:
    sizes = {0: 26, 1: 10, 2: 6, 3: 10, 4: 14, 5: 12, 6: 52, 100: 80, 101: 28, 106: 12, 107: 9}
    assert {number: size_of(number) for number in GROUPS} == sizes
    assert sorted(PACKETS) == list(range(7, 59))
