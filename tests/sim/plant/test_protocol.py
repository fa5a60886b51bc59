"""The plant's protocol: cut from a stream anywhere, and nothing but itself."""

from __future__ import annotations

import contextlib
import random

import pytest

from colony.runtime.protocol.images import Image
from colony.runtime.protocol.messages import Sample
from colony.sim.plant.protocol import (
    MAX_BYTES_TO_PLANT,
    AttachBase,
    CameraReading,
    DriveBase,
    FromPlant,
    HaltBase,
    PlantProtocolError,
    ProximityReading,
    RingReadings,
    ToPlant,
    Unpacker,
    pack,
    read_from_plant,
    read_to_plant,
)

SAID: tuple[ToPlant, ...] = (
    AttachBase(robot="rome"),
    DriveBase(velocity=1.5, turn=-2.0, number=7, sideways=3.0),
    HaltBase(),
)
HEARD: tuple[FromPlant, ...] = (
    ProximityReading(value=RingReadings(sonar=Sample((1.0,) * 24, 4), infrared=None), t_ns=5),
    CameraReading(value=Image(t_ns=6, height=1, width=2, channels=1, pixels=b"\x00\xff"), t_ns=6),
)


def test_messages_survive_a_stream_cut_anywhere() -> None:
    stream = b"".join(map(pack, SAID))
    for size in (1, 2, 3, 7, len(stream)):
        unpacker = Unpacker(MAX_BYTES_TO_PLANT)
        pieces = [stream[i : i + size] for i in range(0, len(stream), size)]
        got = [read_to_plant(payload) for piece in pieces for payload in unpacker.feed(piece)]
        assert tuple(got) == SAID
    unpacker = Unpacker(10_000)
    assert tuple(map(read_from_plant, unpacker.feed(b"".join(map(pack, HEARD))))) == HEARD


def test_lengths_that_are_not_allowed() -> None:
    for length in (0, 101, 2**32 - 1):
        with pytest.raises(PlantProtocolError, match=f"a message of {length} bytes; expected 1 to 100"):
            list(Unpacker(100).feed(length.to_bytes(4, "big")))


def test_directions_versions_and_types_are_checked() -> None:
    (reading,) = Unpacker(10_000).feed(pack(HEARD[0]))
    with pytest.raises(PlantProtocolError, match="Invalid value"):
        read_to_plant(reading)
    with pytest.raises(PlantProtocolError, match="found version 9"):
        read_to_plant(b"\x09" + reading[1:])
    with pytest.raises(PlantProtocolError, match="found version none"):
        read_to_plant(b"")
    (odd,) = Unpacker(10_000).feed(pack(DriveBase(velocity="fast", turn=0.0)))  # type: ignore[arg-type]
    with pytest.raises(PlantProtocolError, match=r"Expected `float`, got `str`"):
        read_to_plant(odd)


def test_noise_is_refused_and_never_anything_else() -> None:
    print("seed 5")
    rng = random.Random(5)
    (sound,) = Unpacker(10_000).feed(pack(SAID[1]))
    for _ in range(3000):
        noise = bytearray(sound)
        for _ in range(rng.randrange(1, 4)):
            noise[rng.randrange(1, len(noise))] = rng.randrange(256)
        with contextlib.suppress(PlantProtocolError):
            read_to_plant(bytes(noise[: rng.randrange(1, len(noise) + 1)]))
