"""Commands read many files that are changed at random: `tests/cli/mutants.py` has the changes.

    python -m tools.file_mutants --trials 4000 --seed 1

Prints the exit codes of each kind of file, and the first of each problem.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.cli.mutants import cases, try_mutant


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--trials", type=int, default=1000, help="mutants of each file")
    parser.add_argument("--seed", default="1")
    parser.add_argument("--cases", default=".", help="part of the names of the files that are changed")
    options = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = Path(name)
        for case_name, case in cases(folder).items():
            if options.cases not in case_name:
                continue
            counts, wrong = Counter[int | None](), Counter[str]()
            for i in range(options.trials):
                code, found = try_mutant(case_name, case, f"{options.seed}-{i}", folder)
                counts[code] += 1
                if found is not None:
                    wrong[found.problem[-300:]] += 1
                    if wrong[found.problem[-300:]] == 1:
                        print(*found, flush=True)
            print(case_name, dict(counts), wrong.total(), "wrong", flush=True)


if __name__ == "__main__":
    main()
