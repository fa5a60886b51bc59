"""The lexer of the Colony language for Pygments, as pages and printed listings color it."""

from __future__ import annotations

from typing import ClassVar

from pygments.lexer import RegexLexer, bygroups, words
from pygments.token import Comment, Keyword, Name, Number, Operator, Punctuation, String, Whitespace

DECLARING = (
    *("robot", "sensor", "actuator", "enum", "input", "param", "let", "state", "next", "machine", "sequence"),
    "module",
)
RESERVED = (
    *("and", "or", "not", "implies", "if", "then", "else", "in", "is", "by", "suppresses", "inhibits"),
)
CONSTANTS = ("true", "false", "missing")
BEFORE_MINUS = ("range", "bearing", "default", "step")
CLAUSES = (
    *(
        "language",
        "frame",
        "jitter",
        "within",
        "from",
        "to",
        "idle",
        "import",
        "as",
        "tunable",
        "start",
        "keep",
    ),
    *(
        "restart",
        "until",
        "when",
        "failsafe",
        "do",
        "python",
        "reads",
        "commands",
        "rate",
        "network",
        "limit",
    ),
    *("requirement", "test", "at", "every", "given", "expect", "taken", "for"),
)
"""Keywords where no operator, bracket or end of a clause follows: there they are names."""

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
_UNIT = (
    r"(?:(?:percent|degC|inch|deg|rad|Hz|Ah|Wh|cm|ft|kg|mA|mV|min|mm|ms|A|N|V|W|g|m|s)"
    r"(?:\^-?[0-9]+)?(?:[*/]|(?![A-Za-z0-9_])))+(?<![*/])"
)
_NO_NAME = (
    r"(?![\[(.]|[ \t]*(?:=|!=|->|[:,)\]}+*/<>#]|$|\.\.|"
    r"(?:and|or|implies|then|else|in|is|by|suppresses|inhibits|for|taken)\b))"
)


class ColonyLexer(RegexLexer):
    """Files that end in `.colony`."""

    name = "Colony"
    aliases: ClassVar[list[str]] = ["colony"]
    filenames: ClassVar[list[str]] = ["*.colony"]
    url = "https://pypi.org/project/colony-pygments/"

    tokens: ClassVar[dict[str, list[tuple[object, ...]]]] = {
        "root": [
            (r"\s+", Whitespace),
            (r"#.*", Comment.Single),
            (r'"[^"\n]*"', String.Double),
            (
                rf"([0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)(?:([ \t]*)({_UNIT}))?",
                bygroups(Number, Whitespace, Keyword.Type),
            ),
            (rf"(\.)([ \t]*)({_NAME})", bygroups(Punctuation, Whitespace, Name.Attribute)),
            (r"(import)([ \t]+)(robot)\b", bygroups(Keyword, Whitespace, Keyword)),
            (
                rf"(contract|reach|assume)([ \t]+)({_NAME})(?=[ \t]*(?:in[ \t]+time\b|requirement\b|:))"
                r"(?:([ \t]+)(in)([ \t]+)(time))?",
                bygroups(Keyword, Whitespace, Name.Function, Whitespace, Operator.Word, Whitespace, Keyword),
            ),
            (
                rf"({'|'.join(DECLARING)})([ \t]+)({_NAME})(?![ \t]*->)",
                bygroups(Keyword.Declaration, Whitespace, Name.Function),
            ),
            (rf"(:)([ \t]*)({_UNIT}|(?:bool|number)\b)", bygroups(Punctuation, Whitespace, Keyword.Type)),
            (r"(is)([ \t]+)(active|commanded|idle)\b", bygroups(Operator.Word, Whitespace, Keyword)),
            (r"any(?=[ \t]*->)", Keyword),
            (r"(on_loss)([ \t]+)(stop|degrade)\b", bygroups(Keyword, Whitespace, Keyword)),
            (r"ago\b(?![\[(.]|[ \t]*[=:])", Keyword),
            (words(RESERVED, suffix=r"\b"), Operator.Word),
            (words(CONSTANTS, suffix=r"\b"), Keyword.Constant),
            (words(BEFORE_MINUS, suffix=rf"\b{_NO_NAME}"), Keyword),
            (words(CLAUSES, suffix=rf"\b(?![ \t]*-){_NO_NAME}"), Keyword),
            (rf"{_NAME}(?=\()", Name.Function),
            (_NAME, Name),
            (r"->|\.\.|<=|>=|==|!=|[-+*/<>=]", Operator),
            (r"[{}()\[\],:.]", Punctuation),
        ]
    }
