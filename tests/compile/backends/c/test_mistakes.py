"""Mistakes that are easily made in C, planted in the generated text: agreement notices each of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import nan

import pytest

from colony.compile.backends.c.generate import generate_c
from colony.compile.backends.c.native import CExecutor, built
from colony.compile.pipeline import Compilation
from colony.dsl.load import load_text
from colony.ir.frame import Frame, Reading
from colony.verify.testing.agreement import Disagreement, disagreement
from tests.compile.backends.c.harness import HERE, STRICT
from tests.sampling import sampled

pytestmark = pytest.mark.skipif(not HERE.is_there, reason="no gcc")

_ROBOT = """
robot tester {
  sensor x : number from DServer.x
  sensor y : number from DServer.y
  sensor near : number range 0 .. 9 from DServer.near within 100 ms
  sensor many[300] : bool from DServer.many
  sensor four[4] : number from DServer.four
  sensor ring[4] : number bearing 0 deg from DServer.ring
  actuator out { v : number } to DServer.out idle hold
}
"""


_NETWORK = """
module above { when it - 1 == it and it > 0 do out(v = 7) }
module below { when it - 1 == it and it < 0 do out(v = -7) }
module finite { when it - it == 0 do out(v = it) }
network { out = above suppresses below suppresses finite }
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mistake:
    """A change of the text, and a value that it changes in the last frame of a run."""

    name: str
    what: str
    instead: str
    value: str
    readings: tuple[tuple[str, Reading], ...]
    t_ns: int = 0


def _mistake(name: str, what: str, instead: str, value: str, t_ns: int = 0, **readings: Reading) -> Mistake:
    return Mistake(
        name=name, what=what, instead=instead, value=value, readings=tuple(readings.items()), t_ns=t_ns
    )


_EITHER_NAN = "if (x != x || y != y) {\n        return (double)NAN;\n    }\n    return y < x ? y : x;"

MISTAKES = (
    _mistake("fmin", _EITHER_NAN, "return fmin(x, y);", "if min(0 / x, y) < 5 then 1 else 2", x=0.0, y=3.0),
    _mistake(
        "zeros of fmin", "return y < x ? y : x;", "return y <= x ? y : x;", "1 / min(x, y)", x=0.0, y=-0.0
    ),
    _mistake(
        "equality with NaN", "reading != reading", "reading == (double)NAN", "if x < 1 then 1 else 2", x=nan
    ),
    _mistake(
        "NaN in an order",
        "(x[best] != x[best] && x[i] == x[i])",
        "false",
        "index_of_min(0 / four)",
        four=[0.0, 2.0, 0.0, 1.0],
    ),
    _mistake(
        "unsigned wrap",
        "f->t_ns - m->first_ns",
        "(int64_t)(uint32_t)(f->t_ns - m->first_ns)",
        "now / 1 s",
        t_ns=5_000_000_000,
    ),
    _mistake(
        "signed age",
        "(uint64_t)t_ns - (uint64_t)taken_ns > (uint64_t)within_ns",
        "(uint32_t)(t_ns - taken_ns) > (uint32_t)within_ns",
        "value_or(near, -1)",
        t_ns=2**32 + 50_000_000,
        near=3.0,
    ),
    _mistake("promotion", "int count = 0;", "uint8_t count = 0;", "count(many)", many=[True] * 300),
    _mistake(
        "contraction",
        "x * y + near",
        "fma(x, y, near)",
        "x * y + value_or(near, 0)",
        x=1.0 + 2.0**-30,
        y=1.0 + 2.0**-30,
        near=1e-20,
    ),
    _mistake(
        "double rounding",
        "x * y + near",
        "(double)(float)(x * y) + near",
        "x * y + value_or(near, 0)",
        x=0.1,
        y=0.3,
        near=1.0,
    ),
    _mistake("truncation", "nearbyint(", "floor(", "four[x]", x=1.6, four=[1.0, 2.0, 3.0, 4.0]),
    _mistake(
        "index out of range",
        "const double rest = fmod(nearbyint(index), (double)size);",
        "const double rest = (double)((int)nearbyint(index) % size);",
        "ring[x]",
        x=2.0**33 + 1,
        ring=[1.0, 2.0, 3.0, 4.0],
    ),
    _mistake(
        "remainder of C", "(y < 0.0) != (rest < 0.0) ? rest + y : rest", "rest", "mod(x, y)", x=-1.0, y=3.0
    ),
    _mistake("negative zero", "return copysign(0.0, y);", "return 0.0;", "1 / mod(x, y)", x=3.0, y=-3.0),
    _mistake(
        "integer division",
        "(double)t / 1e9",
        "(double)(t / INT64_C(1000000000))",
        "now / 1 s",
        t_ns=1_500_000_000,
    ),
)


def found_with(mistake: Mistake, change: bool = True) -> Disagreement | None:
    """Return the disagreement of the text, with the mistake if `change`."""
    program = load_text(f"{_ROBOT}let it = {mistake.value}\n{_NETWORK}")
    given = {"x": 1.0, "y": 1.0, "near": 1.0, "many": [False] * 300, "four": [0.0] * 4, "ring": [0.0] * 4}
    readings: dict[str, Reading] = {**given, **dict(mistake.readings)}  # type: ignore[dict-item]
    taken_ns = {"near": 0} if mistake.name == "signed age" else {}
    trace = [Frame(0, given), *([Frame(mistake.t_ns, readings, taken_ns)] if mistake.t_ns else [])]  # type: ignore[arg-type]
    trace = trace if mistake.t_ns else [Frame(0, readings)]

    def make(compilation: Compilation) -> CExecutor:
        text = generate_c(compilation.compiled)
        source = text.source.replace(mistake.what, mistake.instead) if change else text.source
        assert not change or source != text.source
        return CExecutor(text, built(replace(text, source=source), ["gcc"], [*STRICT, "-O2"]))

    return disagreement(program, trace, {"generated C": make})


@pytest.mark.parametrize(
    "mistake", sampled(MISTAKES, every=5), ids=lambda mistake: mistake.name.replace(" ", "-")
)
def test_agreement_notices(mistake: Mistake) -> None:
    assert found_with(mistake, change=False) is None
    assert found_with(mistake) is not None
