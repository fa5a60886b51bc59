"""Profiles for property tests.

`dev` (the default) and `ci` are deterministic: each test draws from a seed made of its own source. `explore`
draws anew in every run; a failure prints the seed to repeat it with `--hypothesis-seed`. Choose one with
`--hypothesis-profile` or the environment variable HYPOTHESIS_PROFILE.

`--shuffle SEED` shuffles the files, and the tests in each file.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

from tests.paths import ROOT

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # As in a job in the background of a script: processes that tests start would ignore it, too.
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Before numpy is loaded: tests run side by side, and threads of theirs would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

_HOME = tempfile.TemporaryDirectory(prefix="colony-tests-")
"""Folder for what libraries keep, and what tests leave in default folders, not with the user's robots."""
os.environ |= {
    "COLONY_RUN_DIR": f"{_HOME.name}/r",
    "XDG_STATE_HOME": f"{_HOME.name}/s",
    "XDG_CACHE_HOME": f"{_HOME.name}/c",
    "MPLCONFIGDIR": f"{_HOME.name}/m",
}

_CACHE = Path(_HOME.name, "c", "colony")
"""The user's cache: it keeps the tables of the grammar alone, so that each test proves by itself."""
_CACHE.mkdir(mode=0o700, parents=True)
for _folder in ("moments", "proofs"):
    (_CACHE / _folder).touch()
for _file in ("watch-token", "watch.html"):
    (_CACHE / _file).mkdir()

_COMMON = settings(
    deadline=None,  # machines differ
    database=None,  # what was drawn once must not change what is drawn next
    print_blob=True,
    phases=[Phase.explicit, Phase.generate, Phase.shrink],  # not `explain`, which is slow
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("dev", _COMMON, derandomize=True, max_examples=20)
settings.register_profile("ci", _COMMON, derandomize=True, max_examples=1000)
settings.register_profile("explore", _COMMON, derandomize=False, max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "dev"))


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare the options of this suite."""
    parser.addoption("--shuffle", metavar="SEED", help="shuffle the files, and the tests in each file")


def pytest_configure(config: pytest.Config) -> None:
    """Compile the simulator where that is to be done: commands say so, which tests do not expect."""
    if not hasattr(config, "workerinput") and _must_compile():
        subprocess.run([sys.executable, "-c", "import colony.runs.building_run"], cwd=ROOT, check=True)


def _must_compile() -> bool:
    """Whether nothing is kept of the simulator, or a module of it was changed since."""
    kept = list((ROOT / "colony" / "sim").rglob("*.nbi"))
    modules = ((file, file.parents[1] / f"{file.name.partition('.')[0]}.py") for file in kept)
    return not kept or any(
        not module.exists() or module.stat().st_mtime > file.stat().st_mtime for file, module in modules
    )


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Shuffle the tests if `--shuffle` is given; tests of a file stay together, as they share fixtures."""
    seed = config.getoption("shuffle")
    if seed is not None:
        items.sort(key=lambda item: [_drawn(seed, item.nodeid.partition("::")[0]), _drawn(seed, item.nodeid)])


def _drawn(seed: str, name: str) -> float:
    """Return the same number in every process of a run."""
    return random.Random(f"{seed} {name}").random()


def pytest_unconfigure() -> None:
    """Leave nothing behind."""
    _HOME.cleanup()


def pytest_report_header() -> str:
    """Which examples this run draws."""
    return (
        f"hypothesis: {settings().max_examples} examples a test, "
        + ("seeded by each test's source" if settings().derandomize else "seeded anew (printed on failure)")
        + "; other profiles: --hypothesis-profile dev|ci|explore"
    )
