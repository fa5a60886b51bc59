"""Random numbers for the robots' own errors: one stream per robot, independent of other robots."""

from __future__ import annotations

import numpy as np

from colony.sim.compiled import Floats2

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
