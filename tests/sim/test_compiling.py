"""That the simulator is compiled is said when it is, and only then."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from colony.sim.compiling import COMPILING
from tests.paths import ROOT

_CODE = """
import sys
from colony.sim.compiling import told_when_compiling
with told_when_compiling(print):
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


def test_it_is_told_once_when_it_is_compiled_and_not_when_it_is_loaded(tmp_path: Path) -> None:
    for name in ("kernels.py", "kernels_again.py"):
        (tmp_path / name).write_text(_KERNELS)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))}
    said = [
        subprocess.run(
            [sys.executable, "-c", _CODE], env=environment, check=True, capture_output=True, text=True
        ).stdout
        for _ in range(2)
    ]
    assert said == [f"{COMPILING}\n", ""]
