"""`python -m tools.layouts --programs 1000`: drawn programs in each layout, with drawn faults."""

from __future__ import annotations

import argparse
import sys

from tools.drawn_programs import run
from tools.layouts.comparing import compare


def main() -> int:
    """Compare the layouts over the programs of some seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    seeds = range(given.seed, given.seed + given.programs)
    return 0 if run("layouts", compare, seeds, given.workers) else 1


if __name__ == "__main__":
    sys.exit(main())
