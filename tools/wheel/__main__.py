"""The wheel, installed where nothing of the checkout is, and used as the README says: `make wheel`.

Builds the distribution, installs it with all extras into an environment of its own, and types every command
and example of the README in an empty folder, then adds MuJoCo and drives a robot in it. Installs it without
extras into another one, and weighs that.
`--python` names another interpreter to do so with. With `--platforms` it also asks the package index for
wheels of everything for other versions of Python and other machines.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tools.wheel.core import check_core, check_mujoco
from tools.wheel.environments import Environment, build
from tools.wheel.platforms import check_platforms
from tools.wheel.readme import check_readme


def main() -> None:
    options = argparse.ArgumentParser(prog="python -m tools.wheel", description=__doc__)
    options.add_argument("--platforms", action="store_true", help="also look for wheels of other machines")
    options.add_argument("--python", default=sys.executable, help="the interpreter to install it for")
    asked = options.parse_args()
    with tempfile.TemporaryDirectory(prefix="colony-wheel-") as folder:
        place = Path(folder)
        wheel = build(place, asked.python)

        def check_everything() -> None:
            everything = Environment.made(place / "all", asked.python, wheel, "all")
            check_readme(everything, place)
            everything.install(wheel, "mujoco")
            check_mujoco(everything, place)

        with ThreadPoolExecutor() as threads:
            checked = threads.submit(check_everything)
            check_core(Environment.made(place / "core", asked.python, wheel), place)
            checked.result()
        if asked.platforms:
            check_platforms(wheel, place)
    sys.stderr.flush()
    print("the wheel is good")


if __name__ == "__main__":
    main()
