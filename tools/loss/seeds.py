"""Runs of a policy from many seeds, and what comes of them."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager


def run_seeds(name: str, run: Callable[[int], Counter[str]], seeds: range) -> bool:
    """Run every seed, print what failed and what happened, and return True if nothing failed."""
    totals, failed, began = Counter[str](), 0, time.monotonic()
    for seed in seeds:
        try:
            totals += run(seed)
        except AssertionError as problem:
            failed += 1
            print(problem, file=sys.stderr, flush=True)
    took = time.monotonic() - began
    print(f"{name}: {len(seeds)} seeds from {seeds.start} in {took:.0f} s, {failed} failed")
    for what, count in totals.items():
        print(f"  {count:>9} {what}", flush=True)
    return not failed


def fails(run: Callable[[int], object], seed: int) -> bool:
    """Whether a run breaks the policy."""
    try:
        run(seed)
    except AssertionError as problem:
        if not str(problem).startswith(f"seed {seed}"):
            raise
        return True
    return False


@contextmanager
def named(run: str) -> Iterator[None]:
    """Begin the message of whatever does not hold with the name of the run."""
    try:
        yield
    except AssertionError as problem:
        raise AssertionError(f"{run}: {problem}") from problem
