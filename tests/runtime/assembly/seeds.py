"""Runs of a policy from many seeds, and what comes of them, for the modules that are started by hand."""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable


def parser(doc: str | None) -> argparse.ArgumentParser:
    """Return a parser of the seeds to run; `doc` is the docstring of the module."""
    made = argparse.ArgumentParser(description=(doc or "").split("\n", 1)[0])
    made.add_argument("--seeds", type=int, default=1000)
    made.add_argument("--first", type=int, default=0)
    return made


def run_seeds(run: Callable[[int], Counter[str]], options: argparse.Namespace) -> int:
    """Run every seed, print what failed and what happened, and return the exit code."""
    totals, failed, began = Counter[str](), 0, time.monotonic()
    for seed in range(options.first, options.first + options.seeds):
        try:
            totals += run(seed)
        except AssertionError as problem:
            failed += 1
            print(problem, file=sys.stderr, flush=True)
    print(f"{options.seeds} seeds from {options.first} in {time.monotonic() - began:.0f} s, {failed} failed")
    for what, count in totals.items():
        print(f"  {count:>9} {what}")
    return 1 if failed else 0


def fails(run: Callable[[int], object], seed: int) -> bool:
    """Whether a run breaks the policy."""
    try:
        run(seed)
    except AssertionError as problem:
        if not str(problem).startswith(f"seed {seed}"):
            raise
        return True
    return False
