"""`python -m tools.layouts --programs 1000`: drawn programs in each layout, with drawn faults."""

from __future__ import annotations

import argparse
import sys

from tools.drawn_programs import run
from tools.layouts.comparing import compare

REPORTED = 100
"""Number of programs after which the counts and findings so far are printed."""


def main() -> int:
    """Compare the layouts over the programs of some seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    end = given.seed + given.programs
    parts = [range(first, min(end, first + REPORTED)) for first in range(given.seed, end, REPORTED)]
    results = [run("layouts", compare, seeds, given.workers) for seeds in parts]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
