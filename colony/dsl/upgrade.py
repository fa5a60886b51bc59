"""Files of version 1 of the language as files of version 2.

The text is changed only where the new text means the same: `held` becomes `recently`, and the line
`language 2` is added. Edits replace parts of the text, so comments and layout stay as they are. Where version
2 decides differently, a person has to decide (`upgrade_decisions.py`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import fields, replace
from typing import NamedTuple

from colony.dsl import ast
from colony.dsl.check.program import check_program
from colony.dsl.files import ParsedFile, SourceTree
from colony.dsl.language_version import VERSION_LINE
from colony.dsl.parse import SYNTAX_CODES, parse
from colony.ir.program import Program
from colony.record import Record
from colony.text.diagnostics import Diagnostic
from colony.text.source import Source, Span

_RENAMED_FUNCTIONS = {"held": "recently"}
_HEADER = re.compile(r"(?:[ \t]*#[^\r\n]*(?:\r\n|\r(?!\n)|\n))+(?=[ \t\f]*(?:\r|\n))")
"""The comment at the beginning of a file, if an empty line separates it from what follows."""

_LINE_BREAK = re.compile(r"\r\n|\r|\n")
_TEXT_CODES = SYNTAX_CODES | {"E008"}
_REFUSED_SINCE = frozenset({"E217", "E305"})
"""Errors that version 1 did not have; decisions name them."""


class Edit(NamedTuple):
    """The replacement of `text[start:end]` by `new`."""

    start: int
    end: int
    new: str


class UpgradedFile(NamedTuple):
    """A file of a program before and after its upgrade."""

    old: ParsedFile
    new: ParsedFile
    edits: tuple[Edit, ...] = ()
    diagnostics: tuple[Diagnostic, ...] = ()


class UpgradedProgram(NamedTuple):
    """A program with all its files of version 1 upgraded.

    Attributes:
        program: the program, None if it has errors.
        diagnostics: its errors and warnings, at places of the new texts.
        files: its files, the main file last.
    """

    program: Program | None
    diagnostics: tuple[Diagnostic, ...]
    files: tuple[UpgradedFile, ...]

    def errors_before(self) -> tuple[Diagnostic, ...]:
        """Return the errors that version 1 had too, at places of the old texts."""
        errors = (d for d in self.diagnostics if d.severity == "error" and d.code not in _REFUSED_SINCE)
        return tuple(self.with_old_places(d, self.files) for d in errors)

    def with_old_places(self, diagnostic: Diagnostic, files: Iterable[UpgradedFile]) -> Diagnostic:
        """Return a diagnostic whose places in these files are those in their old texts."""
        by_source = {id(file.new.source): file for file in files}

        def old_span(span: Span) -> Span:
            file = by_source.get(id(span.source))
            if file is None:
                return span
            start, end = (_offset_before(file.edits, offset) for offset in (span.start, span.end))
            return Span(file.old.source, start, max(start, end))

        labels = tuple(replace(label, span=old_span(label.span)) for label in diagnostic.labels)
        return replace(diagnostic, span=old_span(diagnostic.span), labels=labels)


def is_version_1(file: ast.File) -> bool:
    """Return True for a file that has no `language` line, or the line `language 1`."""
    return file.language is None or file.language.version == "1"


def upgrade_edits(text: str, file: ast.File) -> tuple[Edit, ...]:
    """Return the edits that make version 2 of a file of version 1, in order; `file` is its syntax tree.

    The line `language 2` is put below a comment that begins the file and is followed by an empty line, and
    otherwise first.
    """
    edits = [
        Edit(call.function.start, call.function.end, _RENAMED_FUNCTIONS[call.function.text])
        for declaration in file.declarations
        for call in _calls(declaration)
        if call.function.text in _RENAMED_FUNCTIONS
    ]
    return tuple(sorted([*edits, _language_line(text, file.language)]))


def apply_edits(text: str, edits: tuple[Edit, ...]) -> str:
    """Return the text after these edits, which are in order and do not overlap."""
    for start, end, new in reversed(edits):
        text = text[:start] + new + text[end:]
    return text


def upgrade_tree(tree: SourceTree) -> UpgradedProgram:
    """Return the program of a file and its imports, upgraded in memory."""
    files = tuple(
        _upgrade_file(file) if is_version_1(file.tree) else UpgradedFile(file, file) for file in tree.files
    )
    parsed_again = {id(file.old.source) for file in files if file.edits}
    kept = [d for d in tree.diagnostics if d.code not in _TEXT_CODES or id(d.span.source) not in parsed_again]
    found = [d for file in files for d in file.diagnostics]
    new_tree = SourceTree(files=tuple(file.new for file in files), diagnostics=(*kept, *found))
    program, diagnostics = check_program(new_tree, tolerated=_REFUSED_SINCE)
    return UpgradedProgram(program, diagnostics, files)


def _upgrade_file(file: ParsedFile) -> UpgradedFile:
    edits = upgrade_edits(file.source.text, file.tree)
    source = Source(file.source.name, apply_edits(file.source.text, edits))
    parsed = parse(source)
    declarations = [d for d in parsed.file.declarations if isinstance(d, ast.ImportDecl)]
    by_path = [i for i in file.imports if isinstance(i.declaration, ast.ImportDecl)]
    imports = (
        *(replace(i, declaration=new) for i, new in zip(by_path, declarations, strict=True)),
        *(i for i in file.imports if i not in by_path),
    )
    new = replace(file, source=source, tree=parsed.file, imports=imports)
    return UpgradedFile(file, new, edits, parsed.diagnostics)


def _offset_before(edits: tuple[Edit, ...], offset: int) -> int:
    """Return the offset in the old text of an offset in the new one."""
    shift = 0
    for edit in edits:
        start = edit.start + shift
        if offset < start:
            break
        if offset < start + len(edit.new):
            return edit.start
        shift += len(edit.new) - (edit.end - edit.start)
    return offset - shift


def _language_line(text: str, line: ast.LanguageDecl | None) -> Edit:
    """Return the edit that writes the line."""
    if line is not None:
        return Edit(line.start, line.end, VERSION_LINE)
    found = _LINE_BREAK.search(text)
    line_break = found[0] if found else "\n"
    header = _HEADER.match(text)
    if header is not None:
        return Edit(header.end(), header.end(), line_break + VERSION_LINE + line_break)
    is_blank = not text or text[0] in "\r\n"
    return Edit(0, 0, VERSION_LINE + line_break * (1 if is_blank else 2))


def _calls(root: Record) -> Iterator[ast.Call]:
    work: list[Record] = [root]
    while work:
        node = work.pop()
        if isinstance(node, ast.Call):
            yield node
        work += _children(getattr(node, field.name) for field in fields(node))  # type: ignore[arg-type]


def _children(values: Iterable[object]) -> Iterator[Record]:
    for value in values:
        if isinstance(value, Record):
            yield value
        elif isinstance(value, tuple):
            yield from _children(value)
