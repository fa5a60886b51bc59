"""Hold the policy for losses over many seeds: whatever dies, freezes, comes back or gets lost on its way.

    python -m tools.loss --seeds 10000             all four oracles
    python -m tools.loss policy --degrade          drawn programs, in which lesser behaviors take over
    python -m tools.loss outside --seeds 1000      real servers, with connections that drive
    python -m tools.loss actuators                 connections at every actuator
    python -m tools.loss proved                    contracts that are proved

Prints what happened, and each seed that breaks the policy. Exit code 1 if there is one.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from functools import partial

from tools.loss import actuators, outside, policy, proved
from tools.loss.seeds import run_seeds


def main() -> int:
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(prog="python -m tools.loss", description=__doc__, formatter_class=form)
    names = ("policy", "outside", "actuators", "proved")
    parser.add_argument("oracles", nargs="*", metavar="ORACLE", help=f"{', '.join(names)} (default: all)")
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--degrade", action="store_true", help="policy: lesser behaviors take over")
    parser.add_argument("--often", metavar="PROCESS", help="policy: the process that fails most often")
    options = parser.parse_args()
    if unknown := [name for name in options.oracles if name not in names]:
        parser.error(f"no oracle `{unknown[0]}`; expected {', '.join(names)}")
    runs: dict[str, Callable[[int], Counter[str]]] = {
        "policy": partial(policy.run, degrade=options.degrade, often=options.often),
        "outside": outside.run,
        "actuators": actuators.run,
        "proved": proved.run,
    }
    seeds = range(options.first, options.first + options.seeds)
    kept = [run_seeds(name, runs[name], seeds) for name in options.oracles or names]
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
