"""The source text of expressions."""

from __future__ import annotations

import re

from colony.ir.expression import Expression
from colony.text.wording import one_line

_COMMENT = re.compile(r"#[^\r\n]*")


def source_text(expression: Expression) -> str:
    """Return the text of an expression on one line, without comments.

    The span of `a and (b)` ends with `b`: parentheses cut off at either end are put back.
    """
    text = one_line(_COMMENT.sub("", expression.span.text))
    depth = deepest = 0
    for c in text:
        depth += (c == "(") - (c == ")")
        deepest = min(deepest, depth)
    return "(" * -deepest + text + ")" * (depth - deepest)
