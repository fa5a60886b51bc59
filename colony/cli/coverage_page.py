"""The page of `colony coverage --html`: the source, and below each line what its obligations lack."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby

from colony.cli.coverage import lacking_text, share_text, steps_of
from colony.text.source import Source
from colony.text.wording import counted
from colony.verify.coverage.measure import Coverage, Measured, State

_WORST: tuple[State, ...] = ("unknown", "uncovered", "covered", "impossible")
"""States of obligations, of which a part of the text has the first that is there."""

_STYLE = """body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 73rem; }
table { border-collapse: collapse; margin-bottom: 1.5rem; }
.counts td, .counts th { border-bottom: 1px solid #ccc; padding: 4px 12px 4px 0; text-align: right; }
.counts td:first-child { text-align: left; }
.source { width: 100%; font: 13px/1.5 ui-monospace, monospace; }
.source td { padding: 0 8px; vertical-align: top; white-space: pre-wrap; overflow-wrap: anywhere; }
.source td:nth-child(-n+2) { color: #595959; text-align: right; width: 1%; white-space: nowrap; }
tr.covered { background: #e7f5ec; } tr.uncovered, tr.unknown { background: #fbe9e2; }
tr.partly { background: #fdf5d8; } tr.impossible { background: #eee; }
mark { background: none; color: inherit; border-bottom: 2px solid; }
mark.covered { border-color: #00664a; } mark.uncovered, mark.unknown { border-color: #a33000; }
mark.uncovered, mark.unknown { font-weight: bold; }
mark.impossible { border-bottom: 2px dotted #888; }
ul { margin: 2px 0 6px; padding-left: 20px; color: #333; font: 13px/1.45 system-ui, sans-serif; }
pre { margin: 0; font: 12px/1.4 ui-monospace, monospace; white-space: pre-wrap; }"""

_LEGEND = (
    "Behind the number of each line stands how many of its obligations are covered, of those that can be. "
    "Underlined in bold is what lacks a frame; dotted, what is proved never to be."
)


def page_of(file: str, coverage: Coverage) -> str:
    """Return the page as HTML that needs no other file; equal coverage gives equal text."""
    by_source: dict[str, tuple[Source, list[Measured]]] = {}
    for m in coverage.measured:
        source = m.obligation.span.source
        by_source.setdefault(source.name, (source, []))[1].append(m)
    parts = [f"<h1>Coverage of {escape(file)}</h1>", f"<p>{_summary(coverage)}</p>", _counts(coverage)]
    parts.append(f"<p>{_LEGEND}</p>")
    for name, (source, measured) in sorted(by_source.items()):
        rows = "\n".join(_lines(coverage, source, measured))
        parts.append(f'<h2>{escape(name)}</h2>\n<table class="source">\n{rows}\n</table>')
    head = f'<meta charset="utf-8"><title>Coverage of {escape(file)}</title><style>{_STYLE}</style>'
    body = "\n".join(parts)
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>{body}</body></html>\n'


def _summary(coverage: Coverage) -> str:
    return f"{share_text(coverage)} in {counted(coverage.frames, 'frame')}"


def _counts(coverage: Coverage) -> str:
    head = "".join(f"<th>{state}</th>" for state in ("", *coverage.counts()))
    rows = (
        f"<tr><td>{kind}</td>{''.join(f'<td>{n}</td>' for n in coverage.counts(kind).values())}</tr>"
        for kind in coverage.kinds()
    )
    return f'<table class="counts"><tr>{head}</tr>\n{"".join(rows)}</table>'


def _lines(coverage: Coverage, source: Source, measured: Sequence[Measured]) -> Iterator[str]:
    """Yield a row for each line of a source."""
    states = _states(source, measured)
    start = 0
    for number, line in enumerate(source.text.splitlines(keepends=True), 1):
        here = [m for m in measured if start <= m.obligation.span.start < start + len(line)]
        text = _marked(line.rstrip("\r\n"), states[start : start + len(line)])
        share = ""
        if here:
            own = coverage._replace(measured=tuple(here))
            share = f"{own.counts()['covered']}/{own.possible}" if own.possible else "–"
        below = "".join(_lacks(coverage, m) for m in here if m.unseen)
        row = f"<td>{number}</td><td>{share}</td><td>{text}{below and f'<ul>{below}</ul>'}</td>"
        yield f'<tr class="{_class(here)}">{row}</tr>'
        start += len(line)


def _class(here: Sequence[Measured]) -> str:
    states = {m.state for m in here} - {"impossible"}
    if not states:
        return "impossible" if here else ""
    return states.pop() if len(states) == 1 else "partly"


def _states(source: Source, measured: Sequence[Measured]) -> list[State | None]:
    """Return the worst state of the obligations about each character of a text."""
    states: list[State | None] = [None] * len(source.text)
    for m in sorted(measured, key=lambda m: -_WORST.index(m.state)):
        span = m.obligation.span
        states[span.start : span.end] = [m.state] * (span.end - span.start)
    return states


def _marked(line: str, states: Sequence[State | None]) -> str:
    parts = []
    for state, run in groupby(zip(line, states, strict=False), key=lambda pair: pair[1]):
        text = escape("".join(character for character, _ in run))
        parts.append(text if state is None else f'<mark class="{state}">{text}</mark>')
    return "".join(parts)


def _lacks(coverage: Coverage, m: Measured) -> str:
    """Return the items for what an obligation lacks, with the steps that would show it."""
    how = {"impossible": "never: ", "unknown": "neither shown nor excluded: "}.get(m.state, "")
    items = [f"{how}{escape(lacking_text(m, goal))}" for goal in m.unseen]
    steps = "\n".join(escape(line) for line in steps_of(coverage.plan, m))
    items[-1] += steps and f"<pre>{steps}</pre>"
    return "".join(f"<li>{item}</li>" for item in items)
