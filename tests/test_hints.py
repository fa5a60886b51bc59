"""What a hint proposes in backquotes is accepted in the place of what was found.

The findings are those of the front end's case files and tables of slips, of docs/errors.md, and of bodies.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from colony.body.reader import body_of_text
from colony.dsl.errors import CODES
from colony.dsl.load import check_file, check_text
from colony.ir.bearings import too_many_hint, uniform
from colony.text.diagnostics import Diagnostic, DiagnosticError
from tests.body import test_consistency, test_reader, test_sensors
from tests.dsl import test_functions, test_inputs, test_messages
from tests.dsl.test_cases import CASES
from tests.dsl.test_error_page import Fence, checked, checked_again, examples
from tests.dsl.texts import ROBOT

Check = Callable[[str], Sequence[Diagnostic]]

_PROPOSED = re.compile(
    r"(?:did you mean|write(?: its unit:)?|if that is an angle, else) (`[^`]+`(?:(?:,| or) `[^`]+`)*)"
)
_FORM = re.compile(r"\.\.\.|\b[A-Z]{3,}\b|\b[abcxy]\b")
"""What a proposal has that shows the form of a text alone."""


_ELSEWHERE = {"E301", "E321", "E702", "E703"}
"""Findings whose proposals are for another place: a command, another file, another table, or a whole file."""


def proposals(found: Diagnostic) -> list[str]:
    if found.code in _ELSEWHERE:
        return []
    texts = re.findall(r"`([^`]+)`", " ".join(_PROPOSED.findall(found.hint or "")))
    return [text for text in texts if not _FORM.search(text)]


def places(text: str, start: int, end: int, proposal: str) -> Iterator[tuple[int, int]]:
    """Yield what a proposal can take the place of: the finding at `start` to `end`, a part of it, or more."""
    yield start, end
    yield start, next(at.end() for at in re.finditer(r"[^\w\s]*", text) if at.end() >= end)
    if "." in text[start:end]:
        yield text.rindex(".", start, end) + 1, end
    if text[end - 1] == "]":
        yield text.index("[", start, end) + 1, end - 1
    number = re.match(r"-?[\d.]+", proposal)
    if number is not None and number.group() in text[start:end]:
        at = text.rindex(number.group(), start, end)
        yield at, at + len(number.group())
    line, after = text.rfind("\n", 0, start) + 1, text.find("\n", end)
    words = []
    for word in re.findall(r"\w+", proposal):
        found = [at.span() for at in re.finditer(rf"\b{word}\b", text[:after]) if at.start() >= line]
        words += [min(found, key=lambda at: max(start - at[1], at[0] - end))] if found else []
    yield min([start, *(a for a, _ in words)]), max([end, *(b for _, b in words)])
    first, last = re.findall(r"\w+|$", proposal)[0], (re.findall(r"\w+", proposal) or [""])[-1]
    before, behind = text.rfind(first, line, start), text.find(last, end, after)
    yield (before if before >= 0 else start), (behind + len(last) if behind >= 0 else end)


def rejected(check: Check, text: str) -> tuple[list[str], int]:
    """Return the findings with proposals that are not accepted, and the number of all proposals."""
    before, bad, count = check(text), [], 0
    for found in before:
        if found.span.source.text != text:
            continue
        accepted = []
        for proposal in proposals(found):
            edits = [
                (text[:a] + new + text[b:], a, a + len(new))
                for a, b in places(text, found.span.start, found.span.end, proposal)
                for new in (proposal, f"{proposal} ", f'"{proposal}"')  # before a name, or a value in TOML
            ]
            accepted.append(any(is_accepted(check(new), a, b) for new, a, b in edits))
        of_units = "write its unit" in (found.hint or "")  # which depends on the meaning
        if accepted and not (any(accepted) if of_units else all(accepted)):
            bad.append(f"{found.code} {found.span.text!r}: {found.message}; hint: {found.hint}")
        count += len(accepted)
    return bad, count


def is_accepted(after: Sequence[Diagnostic], start: int, end: int) -> bool:
    """Return True if nothing is wrong with what took the place of a finding."""
    return not any(d.severity != "note" and start <= d.span.start < max(end, start + 1) for d in after)


def rows(test: Any) -> list[tuple[Any, ...]]:
    """Return the cases of a parametrized test."""
    [mark] = [mark for mark in test.pytestmark if mark.name == "parametrize"]
    return list(mark.args[1])


def language(folder: Path) -> Iterator[tuple[Check, str]]:
    for path in CASES:

        def check(text: str, path: Path = path) -> Sequence[Diagnostic]:
            (folder / path.name).write_text(text)
            return check_file(folder / path.name).diagnostics

        yield check, path.read_text()
    around = {
        test_messages: test_messages.PARTS,
        test_functions: test_functions.NEAR,
        test_inputs: test_inputs.LEFT,
    }
    slips = [(row[0], test_messages.PARTS) for row in test_messages.SLIPS]
    slips += [(row[0], around[module]) for module in (test_functions, test_inputs) for row in module.ERRORS]
    for text, rest in slips:
        yield (lambda text: check_text(text).diagnostics), f"{text}\n{rest}{ROBOT}"


def page(folder: Path) -> Iterator[tuple[Check, str]]:
    for number, (_, files, _) in enumerate(examples([code for code in CODES if code[0] in "EWN"])):
        (folder / str(number)).mkdir()
        os.chdir(folder / str(number))
        for source in {d.span.source.name: d.span.source for d in checked(files)}.values():
            if source.text and Path(source.name).read_bytes() == source.text.encode():

                def check(
                    text: str, name: str = source.name, files: list[Fence] = files
                ) -> Sequence[Diagnostic]:
                    Path(name).write_text(text)
                    try:
                        return [d for d in checked_again(files) if d.span.source.name == name]
                    except DiagnosticError as failure:
                        return failure.diagnostics

                yield check, source.text


def bodies(_: Path) -> Iterator[tuple[Check, str]]:
    def check(text: str) -> Sequence[Diagnostic]:
        return body_of_text(text, "small.toml").diagnostics

    for good, test in (
        (test_consistency.BODY, test_consistency.test_a_contradiction_is_found_at_its_place),
        (test_reader.SMALL + test_reader.LIDAR, test_reader.test_an_error_has_its_place),
        (test_reader.SMALL + test_reader.LIDAR, test_reader.test_an_error_of_a_server_has_its_place),
        (test_sensors.BODY, test_sensors.test_a_contradiction_is_found_at_its_place),
    ):
        for old, new, *_ in rows(test):
            yield check, good.replace(old, new)


@pytest.mark.parametrize(("texts", "at_least"), [(language, 100), (page, 20), (bodies, 3)])
def test_what_a_hint_proposes_is_accepted(
    texts: Callable[[Path], Iterator[tuple[Check, str]]],
    at_least: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    found = [rejected(check, text) for check, text in texts(tmp_path)]
    assert [text for bad, _ in found for text in bad] == []
    assert sum(count for _, count in found) >= at_least


def test_a_ring_that_a_hint_proposes_closes_or_fits() -> None:
    for size in (*range(2, 400), 721, 1081, 4096):
        for step in (360.0 / (size - 1), 361.0 / size, 720.0 / size, -359.0):
            if uniform(0.0, step, size) is not None:
                continue
            hint = too_many_hint(step, size)
            ring = (
                uniform(0.0, -float(match[1]), size)
                if (match := re.search(r"step of (\S+) deg", hint))
                else None
            )
            if ring is not None:
                assert ring.closes
                assert uniform(0.0, step, int(re.findall(r"room for (\d+)", hint)[0])) is not None
            else:
                assert "drop it" in hint
                dropped = uniform(0.0, step, int(re.findall(r"declare (\d+)", hint)[0]))
                assert dropped.closes


def test_a_scan_whose_last_beam_repeats_the_first_has_its_hint() -> None:
    assert too_many_hint(1.0, 361) == (
        "the last element looks where the first one does: drop it, and declare 360 elements"
    )
    assert "step of 0.9944751381 deg" in too_many_hint(1.0, 362)
