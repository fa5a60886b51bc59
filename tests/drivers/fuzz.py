"""Fuzzing of decoders: streams of valid packets are damaged, and a second reading says what must come out.

    python -m tests.drivers.fuzz CODEC --bytes 10000000 --seed 1

Half of the bytes are damaged streams of an emulated robot or of drawn packets; the other half is noise, rich
in the bytes of headers, with single packets between. A case has its own reading of the frame (`frame_at`),
which shares no code with the decoder. A stream is read with it from the first byte to the last: at each place
there is a valid frame, or the reading slides by one byte. A decoder must give exactly these packets, however
the stream is cut into pieces. Besides, of the packets that were not damaged at most two may be lost behind
each damage, and each packet must come out before the longest packet's length has passed behind it.

`fuzz_device.py` holds the dialect to what the device can physically measure, and to not moving it.
"""

from __future__ import annotations

import argparse
import importlib
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from colony.drivers.dialect import Decoder
from tests.drivers.fuzz_device import Device, Trial

CASES = (
    "tests.drivers.tiny:CASE",
    "tests.drivers.pioneer.pioneer:CASE",
    "tests.drivers.create2.create2:CASE",
)
"""The cases of all codecs, as `module:name`; the codec of each is the last part of its module's name."""

LOST_AT_MOST = 2
"""Undamaged packets that may be lost behind one damage."""

BLOCK_PACKETS = 40
"""Packets of a block, of which half are damaged; the block is decoded at once."""

NOISE_BYTES = 100
"""Greatest length of noise between two packets."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A codec to be fuzzed.

    Attributes:
        decoder: makes a decoder.
        packet: draws the bytes of a valid packet.
        frame_at: returns the length of the valid frame that begins at a place of a stream, 0 for none.
        raw: returns the bytes of the frame from which a packet was decoded: its encoding.
        longest: the length of the longest frame in bytes.
        header: bytes that are frequent in noise.
        device: the dialect, and what is known of its device besides.
    """

    decoder: Callable[[], Decoder[Any]]
    packet: Callable[[random.Random], bytes]
    frame_at: Callable[[bytes, int], int]
    raw: Callable[[Any], bytes]
    longest: int
    header: bytes
    device: Device


@dataclass(slots=True)
class Score:
    """What came of a stream. Mutable: sums.

    Attributes:
        size: bytes of all streams.
        sent: packets before any damage.
        damages: damaged places.
        intact: packets that no damage touched, and that were decoded.
        lost: packets that no damage touched, and that were not decoded.
        undetected: decoded packets that nobody sent: damage that the checksum did not find.
        from_noise: undetected packets in noise.
    """

    size: int = 0
    sent: int = 0
    damages: int = 0
    intact: int = 0
    lost: int = 0
    undetected: int = 0
    from_noise: int = 0

    def __str__(self) -> str:
        """Return the figures in a line."""
        rate = self.undetected / self.damages if self.damages else 0.0
        return (
            f"{self.size} bytes, {self.sent} packets, {self.damages} damages: {self.lost} undamaged packets "
            f"lost, {self.undetected} damages undetected ({rate:.2e} a damage), "
            f"{self.from_noise} packets made of noise"
        )


def load(codec: str) -> Case:
    """Return the case of a codec by its name."""
    cases = {path.partition(":")[0].rpartition(".")[2]: path for path in CASES}
    module, _, name = cases[codec].partition(":")
    case: Case = getattr(importlib.import_module(module), name)
    return case


def fuzz(case: Case, size: int, seed: int) -> tuple[Score, Trial]:
    """Fuzz a codec and its dialect with about `size` bytes.

    Raises:
        AssertionError: its decoder does not do what the second reading of the frames does, or its dialect
            lets through what the device cannot measure, or sends what moves it.
    """
    rng = random.Random(seed)
    score, trial = Score(), Trial(case.device, rng)
    damaged = noise = 0
    while damaged + noise < size:
        if damaged <= noise:
            damaged += _fuzz_damaged(case, rng, score, trial)
        else:
            noise += _fuzz_noise(case, rng, score, trial)
    score.size = damaged + noise
    return score, trial


def _fuzz_damaged(case: Case, rng: random.Random, score: Score, trial: Trial) -> int:
    """Fuzz one damaged stream of packets, and return its length."""
    recorded = case.device.recording()
    at = rng.randrange(len(recorded) - BLOCK_PACKETS)
    packets = rng.choice(
        (recorded[at : at + BLOCK_PACKETS], [case.packet(rng) for _ in range(BLOCK_PACKETS)])
    )
    assert all(case.frame_at(packet, 0) == len(packet) <= case.longest for packet in packets)
    stream, intact, damages = _damaged(packets, rng, case.longest)
    found = _checked(case, stream, rng, trial)
    lost = len(set(intact) - found)
    score.sent += len(packets)
    score.damages += damages
    score.intact += len(intact) - lost
    score.lost += lost
    score.undetected += len(found - set(intact) - _repeats(stream, packets))
    assert lost <= LOST_AT_MOST * damages, f"{lost} packets are lost of {stream.hex()}"
    return len(stream)


def _fuzz_noise(case: Case, rng: random.Random, score: Score, trial: Trial) -> int:
    """Fuzz noise with packets between, and return its length."""
    stream, intact = bytearray(), set[tuple[int, int]]()
    recorded = case.device.recording()
    packets = [rng.choice(recorded) for _ in range(BLOCK_PACKETS)]
    frequent = case.header * 16
    for packet in packets:
        size = rng.randrange(NOISE_BYTES)
        stream += bytes(rng.choices(frequent, k=size)) if rng.random() < 0.1 else b""
        stream += bytes(
            rng.choice(frequent) if one < 64 else one_more
            for one, one_more in zip(rng.randbytes(size), rng.randbytes(size), strict=True)
        )
        intact.add((len(stream), len(stream) + len(packet)))
        stream += packet
    whole = bytes(stream + bytes(2 * case.longest))
    found = _checked(case, whole, rng, trial)
    lost = len(intact - found)
    score.sent += len(packets)
    score.intact += len(packets) - lost
    score.lost += lost
    score.from_noise += len(found - intact - _repeats(whole, packets))
    assert lost <= LOST_AT_MOST * len(packets), f"{lost} packets are lost of {whole.hex()}"
    return len(whole)


def _checked(case: Case, stream: bytes, rng: random.Random, trial: Trial) -> set[tuple[int, int]]:
    """Decode a stream, try what came out on the dialect, and return the places of the packets."""
    places = list(_frames(case, stream))
    expected = [stream[at:end] for at, end in places]
    packets = _decoded(case, stream, places, rng)
    decoded = list(map(case.raw, packets))
    assert decoded == expected, f"decoded {decoded}; expected {expected} of {stream.hex()}"
    trial.take(packets)
    return set(places)


def _repeats(stream: bytes, packets: list[bytes]) -> set[tuple[int, int]]:
    """Return the places of all copies of packets: repeated or untouched by a damage within another."""
    places = set()
    for packet in set(packets):
        at = stream.find(packet)
        while at >= 0:
            places.add((at, at + len(packet)))
            at = stream.find(packet, at + 1)
    return places


def _damaged(
    packets: list[bytes], rng: random.Random, quiet: int
) -> tuple[bytes, list[tuple[int, int]], int]:
    """Return a stream of packets with damages, the places of undamaged packets, and the number of damages.

    It ends with zeros, so that an unfinished frame is given up.
    """
    stream = bytearray()
    intact: list[tuple[int, int]] = []
    damages = 0
    for packet in packets:
        data = bytearray(packet)
        if rng.random() < 0.5:
            damages += 1
            rng.choice(DAMAGES)(data, rng)
        if bytes(data) == packet:
            intact.append((len(stream), len(stream) + len(data)))
        stream += data
    return bytes(stream + bytes(2 * quiet)), intact, damages


def _flip(data: bytearray, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _drop(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    del data[at : at + rng.choice((1, 1, 2, 5, len(data)))]


def _repeat(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    data[at:at] = data[at : at + rng.choice((1, 2, 5, len(data)))]


def _insert(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data) + 1)
    data[at:at] = rng.randbytes(rng.choice((1, 2, 5, 40)))


def _split(data: bytearray, rng: random.Random) -> None:
    """Put the beginning of the packet before the packet: a sender that began again."""
    data[:0] = data[: rng.randrange(1, len(data) + 1)]


def _overwrite(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    end = min(len(data), at + rng.choice((1, 2, 5)))
    data[at:end] = rng.randbytes(end - at)


DAMAGES = (_flip, _drop, _repeat, _insert, _split, _overwrite)


def _frames(case: Case, stream: bytes) -> Iterator[tuple[int, int]]:
    """Yield the places of the frames of a stream, as the second reading finds them."""
    at = 0
    while at < len(stream):
        size = case.frame_at(stream, at)
        if size:
            yield at, at + size
        at += size or 1


def _decoded(case: Case, stream: bytes, places: list[tuple[int, int]], rng: random.Random) -> list[Any]:
    """Decode a stream in pieces."""
    decoder = case.decoder()
    found: list[Any] = []
    at = 0
    while at < len(stream):
        end = at + rng.choice((1, 3, 17, 64, 4096))
        found += decoder.feed(stream[at:end])
        at = min(end, len(stream))
        due = sum(1 for _, behind in places if behind + case.longest <= at)
        assert len(found) >= due, f"{due - len(found)} packets are still kept back after {at} bytes"
    return found


def main() -> None:
    """Fuzz the codec of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("codec", choices=[path.partition(":")[0].rpartition(".")[2] for path in CASES])
    parser.add_argument("--bytes", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for part in fuzz(load(options.codec), options.bytes, options.seed):
        print(part)


if __name__ == "__main__":
    main()
