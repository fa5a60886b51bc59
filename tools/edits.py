"""Drawn edits of shipped files: the language server answers whatever half-written text it has.

`python -m tools.edits --edits 10000 --seed 1` deletes, inserts, cuts and swaps pieces of behaviors and
robots, and asks for four things after each. A failure of the server, or of an analysis, ends it with the
text that shows it.
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Iterator, Sequence
from pathlib import Path

from colony.editing.server.methods import FEATURES
from colony.editing.server.protocol import PositionParams, RangeParams
from colony.editing.text import KEYWORDS, Lines, lexemes
from tests.editing.client import NearEditor

ROOT = Path(__file__).parent.parent
SIGNS = (
    "{",
    "}",
    "(",
    ")",
    "[",
    "]",
    '"',
    "#",
    "=",
    "->",
    "..",
    ".",
    ",",
    "<",
    "-",
    "0",
    "3 mm",
    "\n",
    "é",
    "\U0001f916",
    "\0",
)
RESET_AFTER = 25
"""Edits after which a file is as it was."""


def files() -> list[Path]:
    """Return the shipped files."""
    return sorted(path for folder in ("behaviors", "robots") for path in (ROOT / folder).rglob("*.colony"))


def drawn_edit(draw: random.Random, text: str) -> tuple[int, int, str]:
    """Return a change of a text: start, end, and what comes in its place."""
    pieces = list(lexemes(text))
    if not pieces:
        return 0, len(text), "module m {"
    a, b = draw.choice(pieces), draw.choice(pieces)
    match draw.randrange(6):
        case 0:  # delete some pieces
            last = pieces[min(pieces.index(a) + draw.randrange(4), len(pieces) - 1)]
            return a.start, last.end, ""
        case 1:  # insert a word or a sign
            return a.start, a.start, draw.choice([*SIGNS, *sorted(KEYWORDS), b.text]) + draw.choice(["", " "])
        case 2:  # cut a stretch
            end = min(len(text), a.start + draw.randrange(400))
            return a.start, end, ""
        case 3:  # put one piece in the place of another
            return a.start, a.end, b.text
        case 4:  # write a piece in part
            return a.start, a.end, a.text[: draw.randrange(len(a.text) + 1)]
        case _:  # swap two neighbors
            i = min(pieces.index(a), len(pieces) - 2)
            if i < 0:
                return a.start, a.end, ""
            left, right = pieces[i], pieces[i + 1]
            return left.start, right.end, right.text + text[left.end : right.start] + left.text


def requests_at(draw: random.Random, uri: str, text: str) -> Iterator[tuple[str, dict[str, object]]]:
    """Yield requests about drawn places of a document."""
    lines = Lines(text)
    for method, (type_, _) in draw.sample(sorted(FEATURES.items()), 4):
        params: dict[str, object] = {"textDocument": {"uri": uri}}
        offset = draw.randrange(len(text) + 1)
        if type_ is PositionParams:
            params["position"] = NearEditor.as_json(lines.position(offset))
        elif type_ is RangeParams:
            params |= {"range": NearEditor.as_json(lines.range(0, offset)), "context": {"diagnostics": []}}
        yield method, params


def run(paths: Sequence[Path], edits: int, seed: int) -> int:
    """Make drawn edits, with requests after each; return how many requests were answered.

    Raises:
        AssertionError: The server failed; the message has the text.
    """
    draw = random.Random(seed)
    answered = 0
    editor, uri, original = NearEditor(), "", ""
    for number in range(edits):
        if number % RESET_AFTER == 0:
            editor = NearEditor()
            editor.initialize(None, prove=False)
            uri = editor.open(draw.choice(paths).resolve())
            original = editor.texts[uri]
        text = editor.texts[uri]
        start, end, new = drawn_edit(draw, text)
        editor.change(uri, start, end, new)
        if draw.random() < 0.3:
            editor.settle()
        asked = list(requests_at(draw, uri, editor.texts[uri]))
        try:
            for method, params in asked:
                editor.ask(method, params)
                answered += 1
        except Exception as problem:
            raise AssertionError(f"{asked} of {original != text}:\n{editor.texts[uri]}") from problem
        failed = [m["params"]["message"] for m in editor.received if m.get("method") == "window/logMessage"]
        assert not failed, f"{failed[-1]}\n{editor.texts[uri]}"
        editor.received.clear()
    return answered


def main() -> None:
    """Run as a command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--edits", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    answered = run(files(), arguments.edits, arguments.seed)
    print(f"{arguments.edits} edits, {answered} requests answered")


if __name__ == "__main__":
    main()
