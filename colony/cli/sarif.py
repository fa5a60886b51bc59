"""Diagnostics as SARIF 2.1.0 for code hosts and editors: one log with one run of one command.

A finding is a result of the rule that its code names. If a trace shows it (a counterexample), the result has
a code flow with a location for each frame, which viewers can step through. A file that cannot be read is not
a result but a notification, as the standard demands: the tool could not do its work.

The tests validate the output against the standard's own schema:
https://docs.oasis-open.org/sarif/sarif/v2.1.0/
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from colony import __version__
from colony.dsl.errors import CODES as FRONT_END_CODES
from colony.text.codes import CODES
from colony.text.diagnostics import Diagnostic, in_order
from colony.text.source import NOWHERE, Span
from colony.text.wording import counted

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
_UNREADABLE = "E001"
_BASE = "%SRCROOT%"
"""The base of relative file URIs: the folder in which the command ran."""

Object = dict[str, object]


class TraceStep(NamedTuple):
    """A frame of a trace that shows a finding.

    It has the location in the text, the event, and the values by name, in readable form (`{"bumper":
    "true"}`).
    """

    span: Span
    message: str
    values: Mapping[str, str] = {}


def sarif(
    diagnostics: Iterable[Diagnostic],
    *,
    directory: str | Path,
    command: str = "check",
    traces: Mapping[Diagnostic, Sequence[TraceStep]] | None = None,
    bugs: Sequence[str] = (),
) -> str:
    """Return a SARIF 2.1.0 log of a command's findings, each once even if several files import its file.

    Files within `directory` have relative URIs, others absolute ones. Lines and columns count from 1,
    columns and offsets in Unicode code points. `traces` are the frames that lead to a finding, `bugs` are
    bugs of colony itself that the command found.
    """
    traces = traces or {}
    findings = in_order(
        {(d.span.source.name, d.span.start, d.code, d.message): d for d in diagnostics}.values()
    )
    root = os.path.abspath(directory)
    unreadable = [d for d in findings if d.code == _UNREADABLE]
    rules = _rules(d.code for d in findings)
    indices = {code: i for i, code in enumerate(rules)}
    run: Object = {
        "tool": {
            "driver": {
                "name": "colony",
                "version": __version__,
                "semanticVersion": __version__,
                "rules": [_descriptor(code, text) for code, text in rules.items()],
                "notifications": [_descriptor(_UNREADABLE, rules[_UNREADABLE])],
            }
        },
        "automationDetails": {"id": f"colony/{command}/"},
        "originalUriBaseIds": {_BASE: {"uri": _file_uri(root) + ("" if root.endswith("/") else "/")}},
        "columnKind": "unicodeCodePoints",
        "invocations": [
            {
                "executionSuccessful": not unreadable and not bugs,
                "toolExecutionNotifications": [
                    *(_notification(d, root) for d in unreadable),
                    *({"level": "error", "message": {"text": _message(bug)}} for bug in bugs),
                ],
            }
        ],
        "results": [
            _result(d, indices[d.code], traces.get(d, ()), root) for d in findings if d.code != _UNREADABLE
        ],
    }
    return json.dumps({"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}, indent=2)


# --- rules -----------------------------------------------------------------------------------------


def _rules(used: Iterable[str]) -> dict[str, str]:
    """Return the description of every registered code, and of the other codes in `used`."""
    rules = {**FRONT_END_CODES, **CODES}
    for code in used:
        rules.setdefault(code, code)
    return rules


def _descriptor(code: str, description: str) -> Object:
    level = {"W": "warning", "N": "note"}.get(code[0], "error")
    return {
        "id": code,
        "shortDescription": {"text": _message(description)},
        "help": {"text": f"docs/errors.md explains when {code} occurs, and how to fix it."},
        "defaultConfiguration": {"level": level},
    }


# --- results ---------------------------------------------------------------------------------------


def _result(diagnostic: Diagnostic, rule: int, trace: Sequence[TraceStep], root: str) -> Object:
    result: Object = {
        "ruleId": diagnostic.code,
        "ruleIndex": rule,
        "level": diagnostic.severity,
        "message": {"text": _message(_with_hint(diagnostic))},
        "locations": _locations(diagnostic.span, root),
    }
    if diagnostic.labels:
        result["relatedLocations"] = [
            {"message": {"text": _message(label.text)}} | location
            for label in diagnostic.labels
            for location in _locations(label.span, root)
        ]
    if trace:
        steps = [_step(i, step, root) for i, step in enumerate(trace)]
        description = f"{counted(len(steps), 'frame')} that lead to it"
        result["codeFlows"] = [{"message": {"text": description}, "threadFlows": [{"locations": steps}]}]
    return result


def _notification(diagnostic: Diagnostic, root: str) -> Object:
    return {
        "descriptor": {"id": diagnostic.code, "index": 0},
        "level": diagnostic.severity,
        "message": {"text": _message(_with_hint(diagnostic))},
        "locations": [{"physicalLocation": {"artifactLocation": _artifact(diagnostic.span, root)}}],
    }


def _step(number: int, step: TraceStep, root: str) -> Object:
    location: Object = {"message": {"text": _message(step.message)}}
    for part in _locations(step.span, root):
        location |= part
    result: Object = {"location": location, "executionOrder": number}
    if step.values:
        result["state"] = {name: {"text": _message(value)} for name, value in step.values.items()}
    return result


def _with_hint(diagnostic: Diagnostic) -> str:
    return diagnostic.message + (f"\nHint: {diagnostic.hint}" if diagnostic.hint else "")


_LINK = re.compile(r"\[([^\]]*)\]\(")


def _message(text: str) -> str:
    """Return text in which no brace is a placeholder and no bracket a link (sections 3.11.5 and 3.11.6)."""
    return _LINK.sub(r"\\[\1\\](", text.replace("{", "{{").replace("}", "}}"))


# --- locations ----------------------------------------------------------------------------------------


def _locations(span: Span, root: str) -> list[Object]:
    """Return the location of a span, or no location for a span outside any text."""
    if span.source is NOWHERE.source:
        return []
    line, column = span.source.position(span.start)
    end_line, end_column = span.source.position(span.end)
    region = {
        "startLine": line,
        "startColumn": column,
        "endLine": end_line,
        "endColumn": end_column,
        "charOffset": span.start,
        "charLength": span.end - span.start,
    }
    return [{"physicalLocation": {"artifactLocation": _artifact(span, root), "region": region}}]


def _artifact(span: Span, root: str) -> Object:
    path = os.path.normpath(os.path.join(root, span.source.name))
    inside = os.path.join(root, "")
    if path.startswith(inside):
        return {"uri": quote(os.fsencode(path.removeprefix(inside))), "uriBaseId": _BASE}
    return {"uri": _file_uri(path)}


def _file_uri(path: str) -> str:
    """Return the file URI of an absolute path with any bytes."""
    return "file://" + quote(os.fsencode(path))
