"""Expressions as they are written in the behavior."""

from __future__ import annotations

import re

from colony.ir.expression import Expression

_COMMENT = re.compile(r"#[^\r\n]*")


def written(expression: Expression) -> str:
    """Return the text of an expression on one line, without comments.

    The place of `a and (b)` ends with `b`: the parentheses around its first and last parts are put back.
    """
    text = " ".join(_COMMENT.sub("", expression.span.text).split())
    depth = deepest = 0
    for c in text:
        depth += (c == "(") - (c == ")")
        deepest = min(deepest, depth)
    return "(" * -deepest + text + ")" * (depth - deepest)
