"""The packets of the plant's protocol."""

from __future__ import annotations

import contextlib
import random

import pytest

from colony.runtime.protocol.images import Image
from colony.runtime.protocol.messages import Sample
from colony.sim.plant.protocol import (
    CameraReading,
    DriveBase,
    FromPlant,
    PlantProtocolError,
    ProximityReading,
    RingReadings,
    pack,
    read_from_plant,
    read_to_plant,
)

HEARD: tuple[FromPlant, ...] = (
    ProximityReading(value=RingReadings(sonar=Sample((1.0,) * 24, 4), infrared=None), t_ns=5),
    CameraReading(value=Image(t_ns=6, height=1, width=2, channels=1, pixels=b"\x00\xff"), t_ns=6),
)
DRIVE = DriveBase(velocity=1.5, turn=-2.0, sideways=3.0)


def test_messages_are_read_as_they_were_packed() -> None:
    assert read_to_plant(pack(DRIVE)) == DRIVE
    assert tuple(read_from_plant(memoryview(pack(message))) for message in HEARD) == HEARD


def test_directions_versions_and_types_are_checked() -> None:
    reading = pack(HEARD[0])
    with pytest.raises(PlantProtocolError, match="Invalid value"):
        read_to_plant(reading)
    with pytest.raises(PlantProtocolError, match="found version 9"):
        read_to_plant(b"\x09" + reading[1:])
    with pytest.raises(PlantProtocolError, match="found version none"):
        read_to_plant(b"")
    odd = pack(DriveBase(velocity="fast", turn=0.0))  # type: ignore[arg-type]
    with pytest.raises(PlantProtocolError, match=r"Expected `float`, got `str`"):
        read_to_plant(odd)


def test_noise_is_refused_and_never_anything_else() -> None:
    print("seed 5")
    rng = random.Random(5)
    sound = pack(DRIVE)
    for _ in range(3000):
        noise = bytearray(sound)
        for _ in range(rng.randrange(1, 4)):
            noise[rng.randrange(1, len(noise))] = rng.randrange(256)
        with contextlib.suppress(PlantProtocolError):
            read_to_plant(bytes(noise[: rng.randrange(1, len(noise) + 1)]))
