"""Requirements: their texts, the contracts that belong to them, and whether these are proved."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal, NamedTuple

from colony.files import read_file
from colony.text.toml_places import tables_of
from colony.verify.contracts.report import counted_as
from colony.verify.contracts.results import Result

MAX_TABLE_BYTES = 4 * 1024 * 1024

Status = Literal["met", "open", "unmet", "without contracts", "without text"]
"""The state of a requirement: `met` if all its contracts are proved; one that the table lacks has no text."""

MET = ("proved", "proved_in_time", "reached")
"""The verdicts of contracts that meet a requirement."""

UNMET = ("refuted", "never_reached")
"""The verdicts that show that it is not met; with any other it is open."""


class RequiredContract(NamedTuple):
    """A contract of a requirement; `assuming` names the assumptions that its verdict rests on."""

    name: str
    verdict: str
    assuming: tuple[str, ...]
    in_time: bool


class Requirement(NamedTuple):
    """A requirement, its text ("" if there is none), and its contracts."""

    id: str
    text: str
    status: Status
    contracts: tuple[RequiredContract, ...]


class RequirementTable(NamedTuple):
    """A file with the texts of requirements, by id."""

    name: str
    data: bytes
    texts: dict[str, str]


def read_requirements(path: Path) -> RequirementTable:
    """Return the texts of requirements, from TOML (`"SR-12" = "text"`) or from CSV (`id,text`).

    Raises:
        OSError: the file cannot be read.
        ValueError: it is no such table; the message says what is wrong.
    """
    data = read_file(path, MAX_TABLE_BYTES)
    text = data.decode("utf-8-sig")
    return RequirementTable(path.name, data, _csv(text) if path.suffix.lower() == ".csv" else _toml(text))


def _toml(text: str) -> dict[str, str]:
    table = tables_of(text)
    for name, value in table.items():
        if not isinstance(value, str):
            raise ValueError(f'`{name}` is no text; expected `"{name}" = "..."`')
    return {name: str(value) for name, value in table.items()}


def _csv(text: str) -> dict[str, str]:
    rows = csv.DictReader(io.StringIO(text), strict=True)
    if not {"id", "text"} <= set(rows.fieldnames or ()):
        raise ValueError("the first line must name the columns `id` and `text`")
    found: dict[str, str] = {}
    try:
        for row in rows:
            if not row["id"] or row["id"] in found:
                what = f"`{row['id']}` is there twice" if row["id"] else "an id is missing"
                raise ValueError(f"line {rows.line_num}: {what}")
            found[row["id"]] = row["text"] or ""
    except csv.Error as problem:
        raise ValueError(f"line {rows.line_num}: {problem}") from None
    return found


def requirements_of(texts: Mapping[str, str] | None, results: Iterable[Result]) -> tuple[Requirement, ...]:
    """Return the requirements of a table, in its order, and those that only contracts name, by id.

    Args:
        texts: the table; None without one, and then no text is expected.
        results: the results of all contracts.
    """
    contracts: dict[str, list[RequiredContract]] = {}
    for result in results:
        asked = result.contract
        for id_ in dict.fromkeys(asked.requirements):
            found = RequiredContract(asked.name, counted_as(result), asked.assuming, asked.in_time)
            contracts.setdefault(id_, []).append(found)
    ids = [*(texts or ()), *sorted(contracts.keys() - (texts or {}).keys())]
    return tuple(
        Requirement(
            id=id_,
            text=(texts or {}).get(id_, ""),
            status=_status(contracts.get(id_, ()), has_text=texts is None or id_ in texts),
            contracts=tuple(contracts.get(id_, ())),
        )
        for id_ in ids
    )


def _status(contracts: Iterable[RequiredContract], *, has_text: bool) -> Status:
    verdicts = {contract.verdict for contract in contracts}
    if not has_text:
        return "without text"
    if not verdicts:
        return "without contracts"
    if not verdicts.isdisjoint(UNMET):
        return "unmet"
    return "met" if verdicts <= set(MET) else "open"
