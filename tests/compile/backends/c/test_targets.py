"""Generated C gives the same bits on every target, compiled without a warning."""

from __future__ import annotations

import platform
import re
import shutil
import struct
import subprocess
from pathlib import Path

import pytest

from colony.compile.backends.c.generate import generate_c
from colony.compile.backends.c.native import CExecutor, built
from colony.compile.backends.c.single import in_floats
from colony.compile.pipeline import Compilation, compile_program
from colony.dsl.load import load_file
from colony.ir.frame import Frame
from colony.verify.testing.agreement import disagreement
from tests.compile.backends.c.harness import (
    AARCH64,
    CLANG,
    CORTEX_M4,
    CORTEX_M7,
    HERE,
    SANITIZED,
    Target,
    drawn,
    main_text,
    run,
)
from tests.drawn.strategies import run_of_seed
from tests.paths import BEHAVIORS, ROOT
from tests.programs import compilation, robot
from tests.sampling import sampled

SEEDS = (1, 4, 8, 11, 24)
"""Seeds of programs without modules in Python."""

pytestmark = pytest.mark.skipif(not HERE.is_there, reason="no gcc")


@pytest.mark.parametrize("seed", sampled(SEEDS, every=5))
@pytest.mark.parametrize(
    "target", [SANITIZED, CLANG, AARCH64, CORTEX_M7, CORTEX_M4], ids=lambda target: target.name
)
def test_outcomes_are_the_same_on_every_target(target: Target, seed: int, tmp_path: Path) -> None:
    if not target.is_there:
        pytest.skip(f"no {target.compiler[0]} or no emulator")
    text, trace = drawn(seed)
    main = main_text(text, trace)
    assert run(target, text, main, tmp_path) == run(HERE, text, main, tmp_path)


@pytest.mark.parametrize("path", sampled(BEHAVIORS, every=8), ids=lambda path: path.stem)
@pytest.mark.parametrize("target", [HERE, CLANG], ids=lambda target: target.name)
def test_shipped_behaviors_compile_without_a_warning(target: Target, path: Path, tmp_path: Path) -> None:
    text = generate_c(compile_program(load_file(path)).compiled, path.stem)
    run(target, text, main_text(text, []), tmp_path)


@pytest.mark.parametrize("options", [("gcc", "-O0"), ("gcc", "-O2"), ("clang", "-O2")], ids=" ".join)
@pytest.mark.parametrize("seed", sampled(range(30), every=30))
@pytest.mark.parametrize("network", [True, False], ids=["network", "whole"])
def test_generated_c_agrees_with_the_interpreter(seed: int, network: bool, options: tuple[str, str]) -> None:
    program, trace = run_of_seed(seed, network=network)
    if compile_program(program).compiled.python_modules:
        pytest.skip("it has a module in Python")
    command, level = options

    def make(compilation: Compilation) -> CExecutor:
        text = generate_c(compilation.compiled)
        return CExecutor(text, built(text, [command], ["-std=c99", "-ffp-contract=off", level]))

    found = disagreement(program, trace, {"generated C": make})
    assert found is None, str(found)


def test_the_example_of_the_page_compiles_and_runs(tmp_path: Path) -> None:
    [example] = re.findall(r"^```c main.c\n(.*?)^```$", (ROOT / "docs/native.md").read_text(), re.M | re.S)
    text = generate_c(compile_program(load_file(ROOT / "behaviors/wander.colony")).compiled, "wander")
    assert run(HERE, text, example, tmp_path).split() == ["cruise", "600"] * 3


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ("gcc -std=c99 -O2 -ffast-math", "-ffast-math"),
        ("gcc -std=c99 -O2 -mfpmath=387", "FLT_EVAL_METHOD"),
        ("gcc -std=gnu99 -O2 -mfma", "-ffp-contract=off"),
        ("gcc -std=gnu99 -O2 -mfma -ffp-contract=off -DCOLONY_NO_CONTRACTION", None),
        ("gcc -std=c99 -O2 -mfma", None),
        ("arm-none-eabi-gcc -std=c99 -mcpu=cortex-m4 -mthumb", None),
        ("avr-gcc -std=c99", "64 bits"),
    ],
)
def test_compilers_that_would_compute_something_else_are_refused(
    options: str, why: str | None, tmp_path: Path
) -> None:
    command, *rest = options.split()
    if shutil.which(command) is None or ("-mf" in options and platform.machine() != "x86_64"):
        pytest.skip(f"no {command}")
    text = generate_c(compilation(ANGLES).compiled, "p")
    (tmp_path / "p.h").write_text(text.header)
    (tmp_path / "p.c").write_text(text.source)
    done = subprocess.run(
        [command, *rest, "-fsyntax-only", "p.c"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode == 0) == (why is None), done.stderr
    assert (why or "") in done.stderr


@pytest.mark.parametrize("target", [HERE, CLANG, CORTEX_M4], ids=lambda target: target.name)
def test_floats_say_that_they_are_unproved_and_compile(target: Target, tmp_path: Path) -> None:
    if not target.is_there:
        pytest.skip(f"no {target.compiler[0]} or no emulator")
    text = generate_c(compilation(ANGLES).compiled)
    trace = [Frame(0, {"angle": angle, "x": angle / 400}) for angle in (-200.0, -30.0, 0.0, 60.0, 135.0)]
    folders = [tmp_path / name for name in ("doubles", "floats")]
    for folder in folders:
        folder.mkdir()
    main = main_text(text, trace)
    doubles, floats = run(target, text, main, folders[0]), run(target, in_floats(text), main, folders[1])
    assert all("UNPROVED" in part for part in (in_floats(text).header, in_floats(text).source))
    assert "double" not in re.sub(r"/\*.*?\*/", "", in_floats(text).source)
    assert doubles != floats
    for exact, rough in zip(doubles.split(), floats.split(), strict=True):
        if len(set(exact)) > 2:  # a number, not a small integer
            [x], [y] = (struct.unpack(">d", bytes.fromhex(bits)) for bits in (exact, rough))
            assert y == pytest.approx(x, rel=1e-5)


ANGLES = (
    robot()
    + """
module m { when true do out(v = sin(angle) + 2 * cos(angle) + tan(angle / 3) + atan2(x, 0.3) / 1 deg
                                + (asin(x) + 3 * acos(x)) / 1 deg) }
network { out = m }
"""
)
