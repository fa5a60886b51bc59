"""The report of `colony verify --report FOLDER`: requirements, contracts, tests and inputs, as HTML and JSON.

Equal inputs give equal bytes: it has no time, and no path but those of its inputs.
"""

from __future__ import annotations

import hashlib
import json
import platform
import sys
from collections.abc import Iterable, Sequence
from contextlib import redirect_stdout
from html import escape
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from colony import __version__
from colony.cli.outputs import write_whole
from colony.cli.params_choice import chosen_params
from colony.cli.progress import proof_progress
from colony.cli.verify.work import Verified
from colony.files import reason
from colony.ir.version import SEMANTICS
from colony.text.source import Span
from colony.text.wording import counted
from colony.verify.requirements import (
    MET,
    UNMET,
    Requirement,
    RequirementTable,
    read_requirements,
    requirements_of,
)

if TYPE_CHECKING:
    from colony.verify.coverage.measure import Coverage

TRUSTED = (
    "the reference interpreter, which is the language reference, executed",
    "the encoding of a program for z3, which is held to the interpreter by tests",
    "z3's answer `unsatisfiable`; cvc5 checks it as well with `colony verify --certificate`",
    "for `over reals`: that no number rounds",
    "for contracts `in time`: that no client is late or lost",
    "that sensors, motors and clocks do what the interface declares; no proof is about them",
)
"""The trusted base, in short; docs/theory.md gives the reasons."""


def requirements_table(path: Path | None) -> RequirementTable | None:
    """Return the table of requirements, None without one; exit with 2 if it cannot be read."""
    if path is None:
        return None
    try:
        return read_requirements(path)
    except OSError as problem:
        raise click.UsageError(f"cannot read {path}: {reason(problem)}") from None
    except ValueError as problem:
        raise click.UsageError(f"{path}: {problem}") from None


def write_report(
    folder: Path,
    table: RequirementTable | None,
    files: Sequence[Verified],
    *,
    on_stderr: bool,
) -> bool:
    """Write `report.json` and `index.html` into a folder, and say what is not met.

    Returns:
        True if each requirement is met.
    """
    results = [result for verified in files for result in verified.results]
    requirements = requirements_of(None if table is None else table.texts, results)
    found = _report(files, table, requirements)
    write_whole(folder / "report.json", json.dumps(found, indent=2) + "\n")
    write_whole(folder / "index.html", _html(found))
    open_ = [requirement for requirement in requirements if requirement.status != "met"]
    for requirement in open_:
        contracts = ", ".join(f"{c.name} {c.verdict}" for c in requirement.contracts)
        text = f"requirement {requirement.id}: {requirement.status}{contracts and f' ({contracts})'}"
        click.echo(text, err=on_stderr)
    met = len(requirements) - len(open_)
    count = counted(len(requirements), "requirement")
    click.echo(f"{met} of {count} met: {folder / 'index.html'}", err=on_stderr)
    return not open_


def _report(
    files: Sequence[Verified], table: RequirementTable | None, requirements: Iterable[Requirement]
) -> dict[str, Any]:
    site = chosen_params()
    covered = [_covered(verified) for verified in files]
    programs = [file.program for file in files if file.program]
    inputs = [(path, source.text.encode()) for program in programs for path, source in program.files]
    inputs += [] if table is None else [(table.name, table.data)]
    inputs += [] if site is None else [(Path(site.file).name, Path(site.file).read_bytes())]
    return {
        "versions": {
            "colony": __version__,
            "semantics": SEMANTICS,
            "python": platform.python_version(),
            "z3": metadata.version("z3-solver"),
        },
        "inputs": [
            {"path": path, "sha256": hashlib.sha256(data).hexdigest()} for path, data in dict(inputs).items()
        ],
        "requirements": [
            {
                **each._asdict(),
                "contracts": [
                    {
                        "contract": c.name,
                        "verdict": c.verdict,
                        "assuming": list(c.assuming),
                        "in_time": c.in_time,
                    }
                    for c in each.contracts
                ],
                "coverage": _counted(
                    [c.of_contracts(required.name for required in each.contracts) for c in covered]
                ),
            }
            for each in requirements
        ],
        "files": [
            {**_file(verified), "coverage": _coverage_row(each)}
            for verified, each in zip(files, covered, strict=True)
        ],
        "trusted": TRUSTED,
    }


def _file(verified: Verified) -> dict[str, Any]:
    """Return the results of a file: its contracts, its tests, and what else was found."""
    from colony.verify.contracts.report import row
    from colony.verify.testing.examples import run_examples

    program = verified.program
    assert program is not None
    paths = {source.name: path for path, source in program.files}
    contracts = [
        {
            **row(program, result),
            "file": paths.get(result.contract.span.source.name, verified.file),
            "requirements": result.contract.requirements,
        }
        for result in verified.results
    ]
    with redirect_stdout(sys.stderr):  # for prints of Python modules
        tests = [{"test": each.name, "passed": each.passed} for each in run_examples(program)]
    name = next((path for path, _ in reversed(program.files)), Path(verified.file).name)
    findings = [f"{d.code}: {d.message}" for d in verified.diagnostics]
    return {"file": name, "contracts": contracts, "tests": tests, "findings": findings}


class _Covered(NamedTuple):
    """The coverage of a file by its tests, and the names of what each contract depends on."""

    all: Coverage
    needs: dict[str, frozenset[str]]

    def of_contracts(self, names: Iterable[str]) -> Coverage:
        """Return the coverage of contracts, and of the declarations that they depend on."""
        return self.all.of({x for name in names for x in (name, *self.needs.get(name, ()))})


def _covered(verified: Verified) -> _Covered:
    from colony.verify.contracts.results import with_reaches
    from colony.verify.contracts.slicing import needs_of_slices
    from colony.verify.coverage.measure import coverage_by_tests

    assert verified.checked is not None
    needs = needs_of_slices(with_reaches(verified.checked))
    with proof_progress() as (on_progress, _), redirect_stdout(sys.stderr):  # for prints of Python modules
        coverage = coverage_by_tests(verified.checked, on_progress)
    return _Covered(coverage, {name: each.values | each.parts for name, each in needs.items()})


def _counted(coverages: Sequence[Coverage]) -> dict[str, int]:
    """Return how many obligations are covered, of those that can be."""
    covered = sum(coverage.counts()["covered"] for coverage in coverages)
    return {"covered": covered, "possible": sum(coverage.possible for coverage in coverages)}


def _line(span: Span) -> str:
    return f"{Path(span.source.name).name}:{span.source.position(span.start)[0]}"


def _coverage_row(found: _Covered) -> dict[str, Any]:
    from colony.cli.coverage import lacking_text

    lacking = {
        state: [
            f"{_line(m.obligation.span)}: {lacking_text(m, g)}"
            for m in found.all.measured
            if m.state == state
            for g in m.unseen
        ]
        for state in ("uncovered", "unknown", "impossible")
    }
    return {**_counted([found.all]), **lacking}


def _remarks(contract: dict[str, Any]) -> Iterable[str]:
    """Yield what restricts a verdict, and the reasons of one that is open."""
    if contract.get("operators") is False:
        yield "without operators"
    if contract.get("assuming"):
        yield f"assuming {', '.join(contract['assuming'])}"
    yield from contract.get("because", ()) or contract.get("over_reals", ())


_STYLE = """body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 64rem; }
table { border-collapse: collapse; width: 100%; margin-bottom: 1.5rem; }
td, th { border-bottom: 1px solid #ccc; padding: 4px 10px 4px 0; text-align: left; vertical-align: top; }
code { font-size: 13px; overflow-wrap: anywhere; } .good { color: #00664a; } .bad { color: #a33000; }"""

_GOOD = ("met", "passed", *MET)
_BAD = ("unmet", "open", "unknown", "over_reals", "failed", "without contracts", "without text", *UNMET)


def _rests(contract: dict[str, Any]) -> str:
    """Return the name of a contract, with what its verdict rests on."""
    rests = [f"assuming {', '.join(contract['assuming'])}"] if contract["assuming"] else []
    rests += ["in time"] if contract["in_time"] else []
    return f"{contract['contract']} ({'; '.join(rests)})" if rests else str(contract["contract"])


def _html(found: dict[str, Any]) -> str:
    requirements = [
        (
            each["id"],
            each["text"],
            each["status"],
            ", ".join(map(_rests, each["contracts"])) or "–",
            _share(each["coverage"]) if each["contracts"] else "–",
        )
        for each in found["requirements"]
    ]
    parts = [
        "<h1>Requirements</h1>",
        _table(("requirement", "text", "status", "contracts", "covered by tests"), requirements),
    ]
    for file in found["files"]:
        contracts = [
            (
                each.get("contract") or each["reach"],
                each["verdict"],
                ", ".join(each["requirements"]) or "–",
                f"{each['file']}:{each['line']}",
                "; ".join(_remarks(each)) or "–",
            )
            for each in file["contracts"]
        ]
        tests = [(each["test"], "passed" if each["passed"] else "failed") for each in file["tests"]]
        parts += [
            f"<h2>{escape(file['file'])}</h2>",
            _table(("contract", "verdict", "requirements", "place", "remarks"), contracts),
            _table(("test", "result"), tests),
            f"<p>Covered by tests: {_share(file['coverage'])} obligations</p>",
            *(
                _table((heading,), [(text,) for text in file["coverage"][heading]])
                for heading in ("uncovered", "unknown", "impossible")
                if file["coverage"][heading]
            ),
            *([_table(("findings",), [(text,) for text in file["findings"]])] if file["findings"] else []),
        ]
    hashes = [(each["path"], each["sha256"]) for each in found["inputs"]]
    versions = [(name, str(version)) for name, version in found["versions"].items()]
    parts += ["<h2>Inputs</h2>", _table(("path", "SHA-256"), hashes), _table(("version of", ""), versions)]
    parts += ["<h2>Trusted</h2>", f"<ul>{''.join(f'<li>{escape(t)}</li>' for t in found['trusted'])}</ul>"]
    head = f'<meta charset="utf-8"><title>Requirements</title><style>{_STYLE}</style>'
    body = "\n".join(parts)
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>{body}</body></html>\n'


def _share(counts: dict[str, int]) -> str:
    return f"{counts['covered']} of {counts['possible']}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    cells = "".join(f"<th>{escape(text)}</th>" for text in head)
    lines = "\n".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>\n{lines}</table>"


def _cell(text: str) -> str:
    kind = ' class="good"' if text in _GOOD else ' class="bad"' if text in _BAD else ""
    return f"<td{kind}>{escape(text.replace('_', ' ')) if kind else escape(text)}</td>"
