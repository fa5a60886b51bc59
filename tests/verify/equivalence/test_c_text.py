"""Generated C: that its guards are proved from the text, and that changes to it are found."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from colony.compile.backends.c.generate import CText, generate_c
from colony.compile.pipeline import Compilation, compile_program
from colony.dsl.load import load_file
from colony.verify.equivalence.prove import prove, prove_c
from colony.verify.equivalence.results import EquivalenceProved, Result, WrongForm, WrongWinner
from tests.drawn.strategies import run_of_seed
from tests.paths import BEHAVIORS
from tests.sampling import sampled

pytest.importorskip("pycparser")


@pytest.mark.parametrize("path", sampled(BEHAVIORS, every=8), ids=lambda path: path.stem)
def test_c_of_shipped_behaviors_is_proved(path: Path) -> None:
    of = compile_program(load_file(path))
    result = prove(of.program, of, c=generate_c(of.compiled, path.stem))
    assert isinstance(result, EquivalenceProved)
    assert result.forms == ("clients", "generated C")


@pytest.mark.parametrize("seed", sampled(range(60), every=10, thorough=True))
@pytest.mark.parametrize("network", [True, False], ids=["network", "whole"])
def test_c_of_drawn_programs_is_proved(seed: int, network: bool) -> None:
    of = compile_program(run_of_seed(seed, network=network)[0])
    if of.compiled.python_modules:
        pytest.skip("it has a module in Python")
    assert isinstance(prove(of.program, of, c=generate_c(of.compiled)), EquivalenceProved)


@cache
def allen() -> tuple[Compilation, CText]:
    [path] = [path for path in BEHAVIORS if path.stem == "allen"]
    of = compile_program(load_file(path))
    return of, generate_c(of.compiled, "allen")


def changed(what: str, instead: str) -> Result:
    of, text = allen()
    parts = [part.replace(what, instead) for part in (text.header, text.source)]
    assert parts != [text.header, text.source]
    return prove_c(of.program, of.clients, replace(text, header=parts[0], source=parts[1]))


@pytest.mark.parametrize(
    ("what", "instead"),
    [
        ("if (collide_active && sensing) {", "if (sensing && !collide_active) {"),
        ("if (collide_active && sensing) {", "if (collide_active || sensing) {"),
        ("t < m->guard_10_until", "t <= m->guard_10_until"),
        ("t < m->guard_10_until", "m->guard_10_until < t"),
        ("m->guard_10_until = t + INT64_C(300000000)", "m->guard_10_until = t + INT64_C(300000001)"),
        ("m->guard_10_until = INT64_C(0)", "m->guard_10_until = INT64_C(1)"),
        ("drive_by = ALLEN_TRAVEL", "drive_by = ALLEN_WANDER"),
        ('"travel", "wander"', '"wander", "travel"'),
        ("ALLEN_TRAVEL = 2", "ALLEN_TRAVEL = 3"),
        ("const bool v310 = !looking;", "const bool v310 = looking;"),
    ],
)
def test_a_change_of_a_guard_is_found(what: str, instead: str) -> None:
    found = changed(what, instead)
    assert isinstance(found, WrongWinner)
    assert found.form == "generated C"
    assert found.network != found.by_priority


@pytest.mark.parametrize(
    ("what", "instead", "found"),
    [
        ("#include <math.h>", "#include <math.h>\n#define sensing true", "other lines for the preprocessor"),
        ("bool sensing =", "bool sensing \\\n =", "other lines for the preprocessor"),
        ("enum allen_module drive_by", "bool sonar;\n    enum allen_module drive_by", "sonar declared twice"),
        ("const bool sensing =", "const bool sensing = clock() == 0 &&", "a call of an unknown function"),
        (
            "const bool sensing =",
            "const bool sensing = colony_bool(&f, 1) &&",
            "a call of an unknown function",
        ),
        (
            "drive_velocity = 0.0;\n            drive",
            "return;\n            drive",
            "a statement of the kind Return",
        ),
        ("void allen_init(", "void allen_step(", "the function allen_step twice"),
        (
            "out->drive.by = drive_by;",
            "out->drive.by = drive_by;\n out->drive.by = drive_by;",
            "a decision too many",
        ),
        ("return y < x ? y : x;", "return fmin(x, y);", "another colony_min"),
        ("void allen_init(", "void allen_begin(", "another allen_begin"),
        ("} while (false);", "} while (true);", "a statement of the kind DoWhile"),
        ("{", "", "ParseError"),
    ],
)
def test_other_text_than_is_generated_is_refused(what: str, instead: str, found: str) -> None:
    result = changed(what, instead)
    assert isinstance(result, WrongForm)
    assert found in result.found
