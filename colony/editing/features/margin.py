"""What editors draw beside the text: findings with their quick fixes, hints, and verdicts as lenses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from colony.editing.index import EditorFinding, Index
from colony.editing.open_file import OpenFile, uri_of
from colony.editing.server.jobs import ProofVerdict
from colony.editing.server.protocol import CodeLens, EditorCommand, Location, TextEdit
from colony.editing.text import Lines, TextRange

SHOW_RUN, WRITE_TEST, RUN_TEST = "colony.showRun", "colony.writeTest", "colony.runTest"
"""The commands of lenses; each takes the URI of a document and the name of a contract or test."""

_SEVERITIES = {"error": 1, "warning": 2, "note": 3}


def diagnostics(index: Index, number: int, findings: Iterable[EditorFinding]) -> list[Any]:
    """Return findings in a file of a program as the protocol has them."""
    lines = {file.path: Lines(file.text) for file in index.files}
    own = lines[index.files[number].path]
    found: list[Any] = []
    for finding in findings:
        row: dict[str, Any] = {
            "range": own.range(finding.start, max(finding.end, finding.start)),
            "severity": _SEVERITIES[finding.severity],
            "code": finding.code,
            "source": "colony",
            "message": finding.message,
        }
        related = [
            {"location": Location(uri_of(label.path), place), "message": label.text}
            for label in finding.labels
            for place in (lines[label.path].range(label.start, label.end),)
        ]
        found.append(row | ({"relatedInformation": related} if related else {}))
    return found


def quick_fixes(file: OpenFile, where: TextRange, findings: Iterable[EditorFinding]) -> list[Any]:
    """Return the changes that mend the findings in a range."""
    start, end = file.lines.offset(where.start), file.lines.offset(where.end)
    found: list[Any] = []
    for finding in findings:
        first, last = file.drift.to_now(finding.start), file.drift.to_now(finding.end)
        if first is None or last is None or first > end or last < start:
            continue
        for fix in finding.fixes:
            edits = file.edits(fix)
            if edits is not None:
                (diagnostic,) = diagnostics(file.known, file.number, [finding])
                diagnostic["range"] = file.lines.range(first, last)
                edit = {"changes": {file.uri: edits}}
                found.append(
                    {
                        "title": fix.title,
                        "kind": "quickfix",
                        "diagnostics": [diagnostic],
                        "edit": edit,
                        "isPreferred": len(finding.fixes) == 1,
                    }
                )
    return found


def inlay_hints(file: OpenFile, where: TextRange) -> list[Any]:
    """Return the hints in a range."""
    start, end = file.lines.offset(where.start), file.lines.offset(where.end)
    places = ((file.drift.to_now(offset), label) for offset, label in file.file.hints)
    return [
        {"position": file.lines.position(offset), "label": label, "paddingLeft": False}
        for offset, label in places
        if offset is not None and start <= offset <= end
    ]


def lenses(
    file: OpenFile, verdicts: Mapping[tuple[str, str], ProofVerdict], state: str
) -> Iterator[CodeLens]:
    """Yield the verdict of each contract, reach and test, and what can be done about it.

    `state` says what is the case with verdicts that are not there yet, or of an earlier text.
    """
    for _, declared in file.own_declarations():
        if declared.kind not in ("contract", "reach", "test"):
            continue
        place = file.place(declared.start, declared.end)
        if place is None:
            continue
        kind = "test" if declared.kind == "test" else "contract"
        verdict = verdicts.get((kind, declared.name))
        known = "" if verdict is None else verdict.word
        yield CodeLens(
            place, EditorCommand(f"{known} ({state})" if state and known else known or state or "?")
        )
        arguments = [file.uri, declared.name]
        if kind == "test":
            yield CodeLens(place, EditorCommand("run this test", RUN_TEST, arguments))
        elif verdict is not None and "\n" in verdict.details:
            title = (
                "show the run that gets there" if declared.kind == "reach" else "show the run that breaks it"
            )
            title = title if verdict.block else "show why"
            yield CodeLens(place, EditorCommand(title, SHOW_RUN, arguments))
            if verdict.block:
                yield CodeLens(place, EditorCommand("write the test", WRITE_TEST, arguments))


def appended(file: OpenFile, block: str) -> TextEdit:
    """Return the edit that appends a test to a document."""
    end = file.lines.position(len(file.text))
    break_ = "\r\n" if "\r\n" in file.text else "\n"
    before = break_ if file.text.endswith("\n") or not file.text else 2 * break_
    return TextEdit(TextRange(end, end), before + block.replace("\n", break_))
