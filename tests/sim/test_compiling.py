"""That the simulator is compiled is said when it is, and only then."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from colony.sim.compiled import Cache
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


def printed(folder: Path, code: str, **variables: str) -> str:
    paths = os.pathsep.join((str(folder), str(ROOT)))
    environment = {**os.environ, "PYTHONPATH": paths, **variables}
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


@pytest.mark.parametrize(
    ("mode", "provided", "place"),
    [
        (0o755, "", "code/__pycache__/own"),
        (0o777, "", "home/numba/*/own"),  # in place of one beside the code that all can write to
        (0o755, "cache", "cache/*/own"),
        (0o755, "open", "code/__pycache__/own"),
        (0o777, "open", "home/numba/*/own"),
        (0o777, "open/home", None),
    ],
)
def test_compiled_code_is_kept_in_a_folder_of_the_user_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int, provided: str, place: str | None
) -> None:
    for name in ("code/__pycache__", "open"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "code" / "__pycache__").chmod(mode)
    (tmp_path / "open").chmod(0o777)
    code = tmp_path / "code" / "kernels.py"
    code.write_text("def double(x):\n    return 2 * x\n")
    function = runpy.run_path(str(code))["double"]
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / provided) if provided else "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / ("home" if place else provided)))
    before = os.umask(0)
    try:
        if place is None:
            with pytest.raises(RuntimeError, match="cannot cache"):
                Cache(function)
            return
        folder = Path(Cache(function).cache_path)
    finally:
        os.umask(before)
    assert [folder] == list(tmp_path.glob(place))
    assert folder.stat().st_mode & 0o777 == 0o700


def test_compiled_code_is_not_kept_without_a_folder_of_the_user_alone(tmp_path: Path) -> None:
    (tmp_path / "kernels.py").write_text(_KERNELS)
    tmp_path.chmod(0o777)
    code = "import kernels, numpy; values = numpy.ones(1); kernels.double(values); print(values[0])"
    assert printed(tmp_path, code, XDG_CACHE_HOME=str(tmp_path / "home")) == "2.0\n"
    assert not list(tmp_path.rglob("*.nb?"))
