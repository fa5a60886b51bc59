"""Generated C with floats in the place of doubles, for processors that have only these: unproved.

What is decided may differ from the interpreter, and no proof or test of a program holds for it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

from colony.compile.backends.c.generate import GUARDS, CText, definitions

UNPROVED = "/* UNPROVED: numbers are floats, so it may decide otherwise than the program. */"

_GUARDS = """\
#if FLT_MANT_DIG != 24 || FLT_MAX_EXP != 128
#error "float must have 32 bits"
#endif
#ifdef __FAST_MATH__
#error "compile without -ffast-math"
#endif
"""

_SCALES = {
    "134217729.0": "4097.0",  # splits the bits of a float in halves
    "1e-200": "1e-30",
    "1e-100": "1e-12",
    "1e100": "1e12",
    ", 600)": ", 60)",
    "-600)": "-60)",
}
"""Constants of the functions of angles that depend on the size of doubles."""

_FUNCTION = re.compile(r"\b(fabs|floor|ceil|nearbyint|fmod|sqrt|copysign|ldexp|frexp)\(")
_NUMBER = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])")
_KEPT = re.compile(r'(/\*.*?\*/|"[^"\n]*"|^#.*?$)', re.DOTALL | re.MULTILINE)


def in_floats(text: CText) -> CText:
    """Return a program with floats in the place of doubles."""
    source = text.source.replace(GUARDS, _GUARDS)
    for definition in definitions().values():
        scaled = definition
        for double, single in _SCALES.items():
            scaled = scaled.replace(double, single)
        source = source.replace(definition, scaled)
    header, source = (_outside(part, _with_floats) for part in (text.header, source))
    return replace(text, header=f"{UNPROVED}\n{header}", source=f"{UNPROVED}\n{source}")


def _outside(text: str, change: Callable[[str], str]) -> str:
    """Return a text changed outside of comments, strings and lines for the preprocessor."""
    parts = _KEPT.split(text)
    return "".join(part if i % 2 else change(part) for i, part in enumerate(parts))


def _with_floats(code: str) -> str:
    code = re.sub(r"\bdouble\b", "float", code)
    return _FUNCTION.sub(r"\1f(", _NUMBER.sub(r"\1f", code))
