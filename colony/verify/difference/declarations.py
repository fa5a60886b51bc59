"""Descriptions of params, derived values and limits that are written differently in two programs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from colony.dsl import ast
from colony.dsl.parse import parse
from colony.ir.program import Program
from colony.text.wording import one_line

_KINDS = {ast.ParamDecl: "param", ast.LetDecl: "let", ast.StateDecl: "state"}


def changed_declarations(a: Program, b: Program) -> tuple[str, ...]:
    """Return a phrase for each value whose text differs, and for each limit that only one program has.

    Files correspond by name; the two main files correspond to each other.
    """
    texts_a, texts_b = dict(_values(a)), dict(_values(b))
    values = (
        f"{kind} `{name}`: `{text}` in A, `{texts_b[kind, name]}` in B"
        for (kind, name), text in texts_a.items()
        if texts_b.get((kind, name), text) != text
    )
    limits_a, limits_b = Counter(_limits(a)), Counter(_limits(b))
    return (
        *values,
        *(f"`{text}` of A" for text in (limits_a - limits_b).elements()),
        *(f"`{text}` of B" for text in (limits_b - limits_a).elements()),
    )


def _values(program: Program) -> Iterator[tuple[tuple[str, str], str]]:
    """Yield ((kind, qualified name), text) of each value."""
    for file, text, declaration in _declarations(program):
        if isinstance(declaration, ast.ModuleDecl):
            module_prefix = f"{file}{declaration.name.text}."
            for clause in declaration.clauses:
                yield from _value(module_prefix, text, clause)
        yield from _value(file, text, declaration)


def _value(prefix: str, text: str, node: object) -> Iterator[tuple[tuple[str, str], str]]:
    match node:
        case ast.ParamDecl() | ast.LetDecl():
            yield (_KINDS[type(node)], prefix + node.name.text), _text_of(text, node.value)
        case ast.StateDecl():
            yield (_KINDS[type(node)], prefix + node.name.text), _text_of(text, node)
        case _:
            return


def _limits(program: Program) -> Iterator[str]:
    for _, text, declaration in _declarations(program):
        if isinstance(declaration, ast.LimitDecl):
            yield _text_of(text, declaration)


def _declarations(program: Program) -> Iterator[tuple[str, str, ast.Declaration]]:
    """Yield the prefix of the file's names, the file's text, and each declaration."""
    for i, (path, source) in enumerate(program.files):
        is_root = i == len(program.files) - 1
        prefix = "" if is_root else path.rpartition("/")[2].removesuffix("colony")
        for declaration in parse(source).file.declarations:
            yield prefix, source.text, declaration


def _text_of(text: str, node: ast.SyntaxNode) -> str:
    return one_line(text[node.start : node.end])
