"""Packets that others wrote or recorded mean here what their sources say; `vectors.toml` has them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from colony.drivers.pioneer.codec import argument_of, command, decoder, encoded
from colony.drivers.pioneer.sip import ConfigSip, read_sip
from tests.drivers.pioneer.pioneer import frame_at

FILE = tomllib.loads(Path(__file__).with_name("vectors.toml").read_text())
VECTORS: list[dict[str, Any]] = FILE["vector"]


def test_there_are_enough_of_them() -> None:
    assert len({vector["bytes"] for vector in VECTORS}) == len(VECTORS) >= 40


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["bytes"][:17])
def test_a_packet_of_others(vector: dict[str, Any]) -> None:
    packet = bytes.fromhex(vector["bytes"])
    found = decoder().feed(packet)
    assert (frame_at(packet, 0) > 0) == (not vector.get("rejected"))
    if vector.get("rejected"):
        assert found == []
        return
    (data,) = found
    assert encoded(data) == packet
    if "data" in vector:
        assert data == bytes.fromhex(vector["data"])
    if "command" in vector:
        assert (data[0], argument_of(data)) == (vector["command"], vector.get("argument"))
        assert command(vector["command"], vector.get("argument")) == packet
    if "sip" in vector:
        sip = read_sip(data)
        assert type(sip).__name__ == vector["sip"]["kind"]
        expected = {name: _frozen(value) for name, value in vector["sip"].items() if name != "kind"}
        assert {name: getattr(sip, name) for name in expected} == expected


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def test_the_recorded_packet_has_bumpers_that_its_robot_has_not() -> None:
    recorded = next(vector for vector in VECTORS if vector.get("sip", {}).get("kind") == "StandardSip")
    (data,) = decoder().feed(bytes.fromhex(recorded["bytes"]))
    sip = read_sip(data)
    assert (sip.front_bumpers, sip.rear_bumpers, sip.battery_fine) == (0x7F, 0x7F, None)  # type: ignore[union-attr]


def test_a_recorded_configuration() -> None:
    """Its end is not published: zeros stand for it, but for a watchdog of 2 s and bumpers."""
    rest = bytes(7) + (2000).to_bytes(2, "little") + bytes(33) + bytes([5, 5])
    config = read_sip(bytes.fromhex(FILE["config"]["data"]) + rest)
    assert isinstance(config, ConfigSip)
    assert (config.identity.type, config.identity.model) == ("Pioneer", "p3dx-sh")
    assert (config.identity.name, config.serial) == ("FAPES_3156", "GJC_3156")
    assert (config.watchdog_ms, config.front_bumpers, config.rear_bumpers) == (2000, 5, 5)
    assert (config.max_turn, config.max_speed) == (360, 1000)
    assert (config.max_turn_acceleration, config.max_acceleration, config.cycle_ms) == (300, 2000, 100)
