"""Counter-based random numbers: a number depends only on a seed and on the event that it is for.

The numbers of a sequential generator depend on the order of the calls. Here the event itself is the argument
(the third crossing of an expansion joint in the floor, pixel 7 of the image taken at 2.5 s), so that an event
has the same number whatever else happens. The hash is that of splitmix64 (Steele, Lea, Flood 2014).

These helpers are compiled into functions of other files. Their cached machine code is rebuilt when those
files change, but not when this one does.
"""

from __future__ import annotations

import hashlib
import math

import numpy as np

from colony.sim.compiled import Floats, Floats2, compiled, inlined

# --- noise ---------------------------------------------------------------------------------------------
#
# Random numbers for the robots' own errors: one stream per robot, independent of other robots.


_BLOCK = 512


class Noise:
    """Standard normal numbers for robots, from a seed. Stateful: keeps the position in the streams.

    The numbers are drawn in blocks, whose size does not affect them.
    """

    def __init__(self, robots: int, seed: int) -> None:
        """Start the streams."""
        seeds = np.random.SeedSequence(seed).spawn(robots)
        self._generators = [np.random.default_rng(child) for child in seeds]
        self._position = 0
        self.table: Floats2 = np.empty((robots, 0))

    def peek(self, count: int) -> Floats2:
        """Return the next `count` numbers of each stream, (robots, count), without consuming them."""
        drawn = [generator.standard_normal(count) for generator in self._generators]
        return np.array(drawn).reshape(len(self._generators), count)

    def take(self, count: int) -> int:
        """Consume `count` numbers of each stream, and return their first column in `table`, (robots, k).

        `table` may be a new array afterwards.
        """
        if self._position + count > self.table.shape[1]:
            unused = self.table[:, self._position :]
            block = np.empty((len(self._generators), max(_BLOCK, count)))
            block[:, : unused.shape[1]] = unused
            for generator, row in zip(self._generators, block, strict=True):
                generator.standard_normal(out=row[unused.shape[1] :])
            self.table, self._position = block, 0
        self._position += count
        return self._position - count


# --- chance --------------------------------------------------------------------------------------------


SLIPS, CROSS_TALK, PEOPLE, PIXELS, BEAMS, DEVICES, FAULTS = range(7)
"""The random streams: the first argument after the seed."""

SEED_MODULUS = 2**62
"""Modulus of seeds: compiled functions have only 64-bit numbers."""


@inlined
def random_bits(seed: int, stream: int, event: int, draw: int) -> np.uint64:
    """Return 64 random bits: draw number `draw` of an event."""
    bits = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(stream) * np.uint64(0xD1B54A32D192ED03)
    bits ^= bits >> np.uint64(29)
    bits = (bits + np.uint64(event)) * np.uint64(0xBF58476D1CE4E5B9)
    bits ^= bits >> np.uint64(27)
    bits = (bits + np.uint64(draw)) * np.uint64(0x94D049BB133111EB)
    bits ^= bits >> np.uint64(31)
    bits *= np.uint64(0xBF58476D1CE4E5B9)
    return bits ^ (bits >> np.uint64(32))


@inlined
def uniform(seed: int, stream: int, event: int, draw: int) -> float:
    """Return a uniform number in [0, 1)."""
    return float(random_bits(seed, stream, event, draw) >> np.uint64(11)) * 2.0**-53


@inlined
def deviate(seed: int, stream: int, event: int, draw: int) -> float:
    """Return a standard normal number, from draws `draw` and `draw` + 1 (Box and Muller 1958)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(seed, stream, event, draw)))
    return radius * math.cos(2.0 * math.pi * uniform(seed, stream, event, draw + 1))


@compiled
def draw_deviates(seed: int, stream: int, event: int, numbers: Floats) -> None:
    """Set `numbers`, (n,), to independent standard normal numbers of an event."""
    for i in range(numbers.shape[0]):
        numbers[i] = deviate(seed, stream, event, 2 * i)


@compiled
def draw_uniforms(seed: int, stream: int, event: int, numbers: Floats) -> None:
    """Set `numbers`, (n,), to independent uniform numbers in [0, 1) of an event."""
    for i in range(numbers.shape[0]):
        numbers[i] = uniform(seed, stream, event, i)


def device_seed(seed: int, robot: int, server: str) -> int:
    """Return the seed of a device: another one for each robot and server."""
    digest = hashlib.blake2b(f"{seed} {robot} {server}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") % SEED_MODULUS
