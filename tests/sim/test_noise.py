from __future__ import annotations

import numpy as np

from colony.sim.chance import Noise


def test_how_much_is_taken_at_a_time_makes_no_difference() -> None:
    one, other = Noise(3, seed=5), Noise(3, seed=5)
    parts = []
    for count in (1, 54, 600, 3, 511, 2, 29):  # across the ends of blocks
        at = one.take(count)
        parts.append(one.table[:, at : at + count].copy())
    at = other.take(1200)
    assert (np.hstack(parts) == other.table[:, at : at + 1200]).all()


def test_a_robot_has_the_same_noise_whoever_else_is_there() -> None:
    alone, among = Noise(1, seed=5), Noise(4, seed=5)
    assert (alone.peek(2)[0] == among.peek(2)[0]).all()
    assert (alone.table[0, alone.take(9) :][:9] == among.table[0, among.take(9) :][:9]).all()
    assert len(np.unique(among.table[:, 0])) == 4


def test_the_first_numbers_are_not_taken_again() -> None:
    noise = Noise(2, seed=1)
    first = noise.peek(2)
    noise.take(600)
    assert not np.isin(first, noise.table).any()
    assert np.abs(noise.table.mean()) < 4.0 / np.sqrt(noise.table.size)
