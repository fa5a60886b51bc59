"""The wheel, installed where nothing of the checkout is, and used as the README says: `make wheel`.

Builds the distribution, installs it with all extras into an environment of its own, and types every command
and example of the README in an empty folder. Installs it without extras into another one, and weighs that. A
robot drives in a third, which has MuJoCo.
`--python` names another interpreter to do so with. With `--platforms` it also asks the package index for
wheels of everything for other versions of Python and other machines.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from tests.wheel.core import check_core, check_mujoco
from tests.wheel.environments import Environment, build
from tests.wheel.platforms import check_platforms
from tests.wheel.readme import check_readme


def main() -> None:
    options = argparse.ArgumentParser(prog="python -m tests.wheel", description=__doc__)
    options.add_argument("--platforms", action="store_true", help="also look for wheels of other machines")
    options.add_argument("--python", default=sys.executable, help="the interpreter to install it for")
    asked = options.parse_args()
    with tempfile.TemporaryDirectory(prefix="colony-wheel-") as folder:
        place = Path(folder)
        wheel = build(place, asked.python)
        check_core(Environment.made(place / "core", asked.python, wheel), place)
        check_readme(Environment.made(place / "all", asked.python, wheel, "all"), place)
        check_mujoco(Environment.made(place / "mujoco", asked.python, wheel, "sim", "mujoco"), place)
        if asked.platforms:
            check_platforms(wheel, place)
    sys.stderr.flush()
    print("the wheel is good")


if __name__ == "__main__":
    main()
