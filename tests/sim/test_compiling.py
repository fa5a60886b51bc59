"""That the simulator is compiled is said when it is, and only then."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from colony.sim.compiling import COMPILING
from tests.paths import ROOT
from tests.sampling import sampled

_CODE = """
import sys
from colony.sim.compiling import announcing_compilation
with announcing_compilation(print):
    import kernels
    import kernels_again
"""

_KERNELS = """from __future__ import annotations
from colony.sim.compiled import Floats, compiled

@compiled
def double(values: Floats) -> None:
    for i in range(len(values)):
        values[i] *= 2.0
"""


_RECORD = """from __future__ import annotations
from typing import NamedTuple
from colony.sim.compiled import Floats, compiled

class {name}(NamedTuple):
    factor: float

@compiled
def scale(values: Floats, by: {name}) -> None:
    for i in range(len(values)):
        values[i] *= by.factor

import numpy
numbers = numpy.ones(1)
scale(numbers, {name}(3.0))
assert numbers[0] == 3.0
"""


def printed(folder: Path, code: str) -> str:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(folder), str(ROOT)))}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout


def test_compiling_is_announced_once_and_loading_is_not(tmp_path: Path) -> None:
    for name in ("kernels.py", "kernels_again.py"):
        (tmp_path / name).write_text(_KERNELS)
    assert [printed(tmp_path, _CODE) for _ in range(2)] == [f"{COMPILING}\n", ""]


def test_a_cache_of_a_class_that_is_gone_is_made_again(tmp_path: Path) -> None:
    for name in ("Scale", "Factor"):
        (tmp_path / "record.py").write_text(_RECORD.format(name=name))
        printed(tmp_path, "import record")
    assert list(tmp_path.rglob("record.scale*.nbi"))


@pytest.mark.parametrize("length", sampled([40, 0, 1], every=3))
def test_a_cache_that_is_cut_off_is_made_again(tmp_path: Path, length: int) -> None:
    (tmp_path / "record.py").write_text(_RECORD.format(name="Scale"))
    printed(tmp_path, "import record")
    for index in tmp_path.rglob("record.scale*.nbi"):
        index.write_bytes(index.read_bytes()[:length])
    printed(tmp_path, "import record")
