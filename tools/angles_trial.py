"""How far the trigonometry of the language is from the truth, in units in the last place, as mpmath knows it.

`python -m tools.angles_trial --count 10000000 --seed 1 --workers 2` takes half an hour; `make angles` runs
it.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from multiprocessing import Pool
from random import Random

from mpmath import mp, mpf

from colony.ir import angles

ROUND = (0.0, 30.0, 45.0, 60.0, 90.0, 120.0, 135.0, 150.0, 180.0, 225.0, 270.0, 315.0, 360.0)
TINY = (5e-324, 1e-310, 2.3e-308, 1e-200, 9.9e-201)
HARD = (
    *(sign * math.nextafter(x, to) for x in ROUND for to in (-math.inf, math.inf) for sign in (1.0, -1.0)),
    *(sign * x for x in (*ROUND, *TINY, 1e22, 2.0**1023, 1.7976931348623157e308) for sign in (1.0, -1.0)),
    *(x * 360.0 + y for x in (1.0, 1e3, 1e9, 1e15) for y in ROUND),
)
"""Angles at which something happens: multiples of 15, their neighbors, and the ends of the floats."""

PARTS = (
    *(k / 16 + d for k in range(17) for d in (-1 / 32, 0.0, 1 / 32) if k / 16 + d <= 1),
    1e-20,
    9.9e-21,
    *TINY,
)
"""Tangents and sines at which the tables of the inverse functions change."""


def units_off(found: float, true: mpf) -> float:
    """Return the distance in units in the last place of the float that is nearest to the truth."""
    return float(abs(mpf(found) - true) / mpf(math.ulp(float(true))))


def truths(x: float) -> Iterator[tuple[str, float, float, mpf]]:
    """Yield name, argument, result and truth for an angle in degrees."""
    rest = math.fmod(x, 360.0)
    exact = mpf(rest) * mp.pi / 180
    sine = mpf(0) if rest % 180.0 == 0.0 else mp.sin(exact)
    cosine = mpf(0) if abs(rest) in (90.0, 270.0) else mp.cos(exact)
    yield "sin", x, angles.sine(x), sine
    yield "cos", x, angles.cosine(x), cosine
    if cosine:
        yield "tan", x, angles.tangent(x), sine / cosine


def inverse_truths(x: float, y: float) -> Iterator[tuple[str, float, float, mpf]]:
    """Yield name, argument, result and truth for the inverse functions; |x| is at most 1."""
    degree = mp.pi / 180
    yield "asin", x, angles.arc_sine(x), mp.asin(mpf(x)) / degree
    yield "acos", x, angles.arc_cosine(x), mp.acos(mpf(x)) / degree
    if x and y:  # the signs of zeros are for the tests
        yield "atan2", x, angles.direction(x, y), mp.atan2(mpf(x), mpf(y)) / degree
        yield "atan2", y, angles.direction(y, x), mp.atan2(mpf(y), mpf(x)) / degree


def angle(random: Random) -> float:
    """Draw an angle of any size, often near one where something happens."""
    draws: tuple[Callable[[], float], ...] = (
        lambda: random.uniform(-360.0, 360.0),
        lambda: random.uniform(-1.0, 1.0) * 10 ** random.uniform(-300, 300),
        lambda: float(random.randrange(-7200, 7200)) / 10,
        lambda: random.choice(HARD) + random.uniform(-1.0, 1.0) * 10 ** random.uniform(-20, 0),
    )
    return random.choice(draws)()


def part(random: Random) -> float:
    """Draw a number in -1 .. 1, often near an end or a place where a table changes."""
    draws: tuple[Callable[[], float], ...] = (
        lambda: random.uniform(0.0, 1.0),
        lambda: 1.0 - 10 ** random.uniform(-16, 0),
        lambda: 10 ** random.uniform(-320, 0),
        lambda: min(1.0, random.choice(PARTS) * random.uniform(0.999, 1.001)),
    )
    return math.copysign(random.choice(draws)(), random.random() - 0.5)


def worst(work: tuple[int, int]) -> dict[str, tuple[float, float]]:
    """Return the worst error of each function, and the argument, over so many draws from a seed."""
    mp.prec = 200
    seed, count = work
    random, found = Random(f"angles {seed}"), dict[str, tuple[float, float]]()
    for _ in range(count):
        y = random.choice((random.uniform(-1.0, 1.0), part(random) * 10 ** random.uniform(-300, 300)))
        for name, x, result, true in (*truths(angle(random)), *inverse_truths(part(random), y)):
            off = units_off(result, true) if true else (0.0 if result == 0.0 else math.inf)
            found[name] = max(found.get(name, (0.0, 0.0)), (off, x))
    return found


def main() -> None:
    """Print the worst error of each function."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000_000, help="draws (default 10000000)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    share = 10_000
    works = [
        (given.seed * 1_000_000 + i, min(share, given.count - i * share))
        for i in range(-(-given.count // share))
    ]
    total = dict[str, tuple[float, float]]()
    with Pool(given.workers) as pool:
        for i, found in enumerate(pool.imap_unordered(worst, works), 1):
            for name, off in found.items():
                total[name] = max(total.get(name, (0.0, 0.0)), off)
            if i % 10 == 0 or i == len(works):
                line = ", ".join(f"{name} {off:.3f} at {x!r}" for name, (off, x) in sorted(total.items()))
                print(f"{min(i * share, given.count)} of {given.count}: {line}", flush=True)


if __name__ == "__main__":
    main()
