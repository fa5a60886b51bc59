"""The TextMate grammar of VS Code and others, made of the words of `grammar.lark` and the units.

    python -m tools.editor_grammar

writes editors/vscode/syntaxes/colony.tmLanguage.json. The language has words that are keywords only where
they can stand, so the patterns go by what is beside them. A test holds them to the lexer on all shipped
files.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from colony.dsl.check.calls import FUNCTION_NAMES
from colony.dsl.parser import CONTEXTUAL_KEYWORDS, GRAMMAR
from colony.text.units import BASE_UNITS

TARGET = Path(__file__).resolve().parent.parent / "editors" / "vscode" / "syntaxes" / "colony.tmLanguage.json"

CONSTANTS = frozenset({"true", "false", "missing"})
TYPES = ("bool", "number")

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
_DECLARING = (
    *("robot", "sensor", "actuator", "enum", "input", "param", "let", "state", "next", "machine", "sequence"),
    "module",
)
"""Keywords before the name of what they declare."""

_BEFORE_MINUS = frozenset({"range", "bearing", "default", "step"})
"""Keywords that a negative number may follow. A minus after others follows a name that is spelled so."""

_BESIDE_OTHERS = frozenset("contract reach assume active commanded time on_loss stop degrade ago".split())
"""Keywords with a pattern of their own."""


def keywords() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the contextual keywords and the reserved words of the grammar, sorted, without constants."""
    words = re.findall(r"^([A-Z_]+)(?:\.2)?: /(\w+)\\b/$", GRAMMAR.read_text(encoding="utf-8"), re.MULTILINE)
    contextual = sorted(word for name, word in words if name in CONTEXTUAL_KEYWORDS)
    reserved = {word for name, word in words if name not in CONTEXTUAL_KEYWORDS | {"ANY"}}
    return tuple(contextual), tuple(sorted(reserved - CONSTANTS))


def unit_pattern() -> str:
    """Return the pattern of a unit, as the grammar has it."""
    units = "|".join(sorted(BASE_UNITS, key=lambda name: (-len(name), name)))
    return rf"(?:(?:{units})(?:\^-?[0-9]+)?(?:[*/]|(?![A-Za-z0-9_])))+(?<![*/])"


def grammar() -> dict[str, Any]:
    """Return the grammar. Its patterns are alike for Oniguruma and for Python, and match within a line."""
    contextual, reserved = keywords()
    loose = sorted(set(contextual) - set(_DECLARING) - _BESIDE_OTHERS - _BEFORE_MINUS)
    after = "|".join(word for word in (*reserved, "for", "taken") if word not in ("not", "if"))
    no_name = rf"(?![\[(.]|[ \t]*(?:=|!=|->|[:,)\]}}+*/<>#]|$|\.\.|(?:{after})\b))"
    number = r"[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?"
    patterns: list[dict[str, Any]] = [
        _match("comment.line.number-sign", "#.*"),
        _match("string.quoted.double", '"[^"]*"'),
        _captured(
            rf"(?<![A-Za-z0-9_])({number})(?:[ \t]*({unit_pattern()}))?",
            "constant.numeric",
            "keyword.other.unit",
        ),
        _captured(r"\b(import)[ \t]+(robot)\b", "keyword.control", "keyword.declaration"),
        _captured(rf"(?<!\.)(\.)[ \t]*({_NAME})", "punctuation.accessor", "variable.other.member"),
        _captured(
            rf"\b(contract|reach|assume)[ \t]+({_NAME})(?=[ \t]*(?:in[ \t]+time\b|requirement\b|:))"
            r"(?:[ \t]+(in)[ \t]+(time))?",
            *("keyword.declaration", "entity.name.contract", "keyword.operator.word", "keyword.control"),
        ),
        _captured(
            rf"\b({'|'.join(_DECLARING)})[ \t]+({_NAME})(?![ \t]*->)",
            "keyword.declaration",
            "entity.name.declaration",
        ),
        _captured(rf"(?<![:<>=!])(:)[ \t]*({unit_pattern()})", "punctuation.separator", "storage.type"),
        _captured(rf"(:)[ \t]*({'|'.join(TYPES)})\b", "punctuation.separator", "storage.type"),
        _captured(r"\b(is)[ \t]+(active|commanded|idle)\b", "keyword.operator.word", "keyword.control"),
        _captured(r"\b(any)(?=[ \t]*->)", "keyword.control"),
        _captured(r"\b(on_loss)[ \t]+(stop|degrade)\b", "keyword.control", "keyword.control"),
        _match("keyword.control", r"\bago\b(?![\[(.]|[ \t]*[=:])"),
        _match("keyword.operator.word", rf"\b(?:{'|'.join(reserved)})\b"),
        _match("constant.language", rf"\b(?:{'|'.join(sorted(CONSTANTS))})\b"),
        _match("keyword.control", rf"\b(?:{'|'.join(sorted(_BEFORE_MINUS))})\b{no_name}"),
        _match("keyword.control", rf"\b(?:{'|'.join(loose)})\b(?![ \t]*-){no_name}"),
        _match("support.function", rf"\b(?:{'|'.join(sorted(FUNCTION_NAMES))})(?=\()"),
        _match("entity.name.function", rf"\b{_NAME}(?=\()"),
        _match("variable.other", rf"\b{_NAME}\b"),
        _match("keyword.operator", r"->|\.\.|<=|>=|==|!=|[-+*/<>=]"),
        _match("punctuation.separator", r"[,:]"),
        _match("punctuation.section", r"[{}()\[\]]"),
    ]
    return {
        "$schema": "https://raw.githubusercontent.com/martinring/tmlanguage/master/tmlanguage.json",
        "name": "Colony",
        "scopeName": "source.colony",
        "fileTypes": ["colony"],
        "patterns": patterns,
    }


def _match(scope: str, pattern: str) -> dict[str, Any]:
    return {"name": f"{scope}.colony", "match": pattern}


def _captured(pattern: str, *scopes: str) -> dict[str, Any]:
    captures = {str(i): {"name": f"{scope}.colony"} for i, scope in enumerate(scopes, start=1)}
    return {"match": pattern, "captures": captures}


def text() -> str:
    """Return the file of the grammar."""
    return json.dumps(grammar(), indent=2) + "\n"


if __name__ == "__main__":
    TARGET.write_text(text(), encoding="utf-8")
