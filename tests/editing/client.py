"""An editor for tests: it speaks the protocol to a session in this process, or to `colony lsp` in its own.

Positions are given as a text that stands once in the document, with `|` where the cursor is.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from colony.editing.open_file import uri_of
from colony.editing.server.jobs import Answer, Job, Unpacking, packed
from colony.editing.server.protocol import Framing, framed
from colony.editing.server.session import EditorSession
from colony.editing.server.worker import Worker
from colony.editing.text import Lines

CAPABLE = {
    "workspace": {
        "codeLens": {"refreshSupport": True},
        "didChangeWatchedFiles": {"dynamicRegistration": True},
    }
}


class Editor:
    """An editor with documents. What the server sends is in `received`; subclasses carry the messages."""

    def __init__(self) -> None:
        self.texts: dict[str, str] = {}
        self.received: list[dict[str, Any]] = []
        self._number = 0
        self._version = 0

    def send(self, message: dict[str, Any]) -> None:
        raise NotImplementedError

    def wait_for(self, number: int) -> dict[str, Any]:
        raise NotImplementedError

    def settle(self) -> None:
        """Let every pause end, and all work that it begins."""
        raise NotImplementedError

    # --- messages

    def ask(self, method: str, params: object) -> Any:
        """Return the result of a request; the error of a refused one is raised as KeyError."""
        self._number += 1
        number = self._number
        self.send({"jsonrpc": "2.0", "id": number, "method": method, "params": params})
        found = self.wait_for(number)
        if "error" in found:
            raise KeyError(found["error"]["message"])
        return found["result"]

    def tell(self, method: str, params: object) -> None:
        self.send({"jsonrpc": "2.0", "method": method, "params": params})

    def initialize(self, folder: Path | None = None, **options: object) -> Any:
        folders = None if folder is None else [{"uri": uri_of(str(folder)), "name": "work"}]
        params = {"workspaceFolders": folders, "capabilities": CAPABLE, "initializationOptions": options}
        found = self.ask("initialize", params)
        self.tell("initialized", {})
        return found

    def session_legend(self) -> list[str]:
        """Return the names of the types of semantic tokens."""
        (found,) = [m["result"] for m in self.received if "capabilities" in (m.get("result") or ())]
        return list(found["capabilities"]["semanticTokensProvider"]["legend"]["tokenTypes"])

    # --- documents

    def open(self, path: Path, text: str | None = None) -> str:
        uri = uri_of(str(path))
        self.texts[uri] = path.read_text(encoding="utf-8") if text is None else text
        item = {"uri": uri, "languageId": "colony", "version": 1, "text": self.texts[uri]}
        self.tell("textDocument/didOpen", {"textDocument": item})
        return uri

    def change(self, uri: str, start: int, end: int, text: str) -> None:
        lines = Lines(self.texts[uri])
        place = self.as_json(lines.range(start, end))
        self.texts[uri] = lines.text[:start] + text + lines.text[end:]
        self._version += 1
        document = {"uri": uri, "version": self._version + 1}
        changes = [{"range": place, "text": text}]
        self.tell("textDocument/didChange", {"textDocument": document, "contentChanges": changes})

    def replace(self, uri: str, old: str, new: str) -> None:
        """Replace a text that stands once in a document."""
        assert self.texts[uri].count(old) == 1, old
        start = self.texts[uri].index(old)
        self.change(uri, start, start + len(old), new)

    def apply(self, edit: dict[str, Any]) -> None:
        """Make the changes of a workspace edit, the last of a document first."""
        for uri, edits in edit["changes"].items():
            for change in sorted(
                edits,
                key=lambda e: (e["range"]["start"]["line"], e["range"]["start"]["character"]),
                reverse=True,
            ):
                lines = Lines(self.texts[uri])
                start, end = (self._offset(lines, change["range"][which]) for which in ("start", "end"))
                self.change(uri, start, end, change["newText"])

    def _offset(self, lines: Lines, position: dict[str, int]) -> int:
        from colony.editing.text import TextPosition

        return lines.offset(TextPosition(position["line"], position["character"]))

    @staticmethod
    def as_json(value: object) -> Any:
        import msgspec

        return msgspec.to_builtins(value)

    # --- requests

    def at(self, uri: str, marked: str) -> dict[str, Any]:
        """Return the parameters of a request at the `|` of a text that stands once in a document."""
        text = marked.replace("|", "")
        assert self.texts[uri].count(text) == 1, (marked, self.texts[uri].count(text))
        return self.at_offset(uri, self.texts[uri].index(text) + marked.index("|"))

    def at_offset(self, uri: str, offset: int) -> dict[str, Any]:
        position = self.as_json(Lines(self.texts[uri]).position(offset))
        return {"textDocument": {"uri": uri}, "position": position}

    def about(self, uri: str) -> dict[str, Any]:
        lines = Lines(self.texts[uri])
        return {"textDocument": {"uri": uri}, "range": self.as_json(lines.range(0, len(lines.text)))}

    def hover(self, uri: str, marked: str) -> str:
        found = self.ask("textDocument/hover", self.at(uri, marked))
        return "" if found is None else str(found["contents"]["value"])

    def completions(self, uri: str, marked: str) -> list[str]:
        return self._completions(self.at(uri, marked))

    def completions_at(self, uri: str, offset: int) -> list[str]:
        return self._completions(self.at_offset(uri, offset))

    def _completions(self, at: dict[str, Any]) -> list[str]:
        found = self.ask("textDocument/completion", at)
        return [item["label"] for item in sorted(found, key=lambda item: item.get("sortText", item["label"]))]

    def text_at(self, location: dict[str, Any]) -> str:
        """Return the text of a location in an open document."""
        lines = Lines(self.texts[location["uri"]])
        start, end = (self._offset(lines, location["range"][which]) for which in ("start", "end"))
        return lines.text[start:end]

    def lenses(self, uri: str) -> list[str]:
        """Return the titles of the lenses, each after the name above which it stands."""
        found = self.ask("textDocument/codeLens", self.about(uri))
        return [f"{self.text_at({'uri': uri, 'range': x['range']})}: {x['command']['title']}" for x in found]

    def fix(self, uri: str, title: str) -> None:
        """Make the changes of the quick fix with a title."""
        found = self.ask("textDocument/codeAction", {**self.about(uri), "context": {"diagnostics": []}})
        (edit,) = [action["edit"] for action in found if action["title"] == title]
        self.apply(edit)

    def findings(self, uri: str) -> list[str]:
        """Return the codes of the last findings of a document."""
        return [row["code"] for row in self.diagnostics(uri)]

    def diagnostics(self, uri: str) -> list[dict[str, Any]]:
        """Return the last findings of a document."""
        published = [
            m["params"] for m in self.received if m.get("method") == "textDocument/publishDiagnostics"
        ]
        last = [params for params in published if params["uri"] == uri][-1]
        found: list[dict[str, Any]] = last["diagnostics"]
        return found


class FarProver:
    """Proofs in a process of their own: what z3 finds depends on what it was asked before in the same one."""

    def answers(self, job: Job) -> Iterator[Answer]:
        command = [sys.executable, "-m", "colony.editing.server.worker"]
        done = subprocess.run(command, input=packed(job), capture_output=True, check=True)
        found: Iterator[Answer] = Unpacking().feed(done.stdout, Answer)  # type: ignore[arg-type]
        yield from found


class NearEditor(Editor):
    """An editor in the process of the server, whose time passes when a test lets it."""

    def __init__(self) -> None:
        super().__init__()
        self.session = EditorSession()
        self.now = 0.0
        self.worker, self.prover = Worker(), FarProver()

    def send(self, message: dict[str, Any]) -> None:
        self.session.receive(json.dumps(message).encode(), self.now)
        self._work()

    def _work(self) -> None:
        """Do all jobs that are due, and take what the session sends."""
        while True:
            self.session.wake(self.now)
            jobs: list[tuple[Worker | FarProver, Job]] = [(self.worker, job) for job in self.session.jobs]
            jobs += [(self.prover, job) for job in self.session.proofs.jobs]
            self.session.jobs.clear()
            self.session.proofs.jobs.clear()
            for worker, job in jobs:
                for found in worker.answers(job):
                    self.session.answered(found, self.now)
            for data in self.session.out:
                self.received += [json.loads(body) for body in Framing().feed(data)]
            self.session.out.clear()
            if not jobs:
                return

    def wait_for(self, number: int) -> dict[str, Any]:
        for _ in range(100):
            for message in self.received:
                if message.get("id") == number and "method" not in message:
                    return message
            self.settle()
        raise AssertionError("no answer")

    def settle(self) -> None:
        self.now += 10.0
        self._work()


class FarEditor(Editor):
    """An editor with `colony lsp` as a process of its own."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        super().__init__()
        self._process = process
        self._framing = Framing()

    def send(self, message: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(framed(message))
        self._process.stdin.flush()

    @property
    def pid(self) -> int:
        return self._process.pid

    def close(self) -> None:
        """Leave without a word."""
        assert self._process.stdin is not None
        self._process.stdin.close()

    def exit_code(self) -> int:
        """Return the exit code of the server, once it has ended."""
        return self._process.wait()

    def read(self) -> None:
        """Take what the server sends next."""
        assert self._process.stdout is not None
        data = self._process.stdout.read1(1 << 16)  # type: ignore[attr-defined]
        assert data, "the server ended"
        self.received += [json.loads(body) for body in self._framing.feed(data)]

    def wait_for(self, number: int) -> dict[str, Any]:
        while True:
            for message in self.received:
                if message.get("id") == number and "method" not in message:
                    return message
            self.read()

    def wait_until(self, is_there: Any) -> Any:
        """Return what `is_there` finds in a message, as soon as one has it."""
        seen = 0
        while True:
            for message in self.received[seen:]:
                found = is_there(message)
                if found:
                    return found
            seen = len(self.received)
            self.read()


@contextmanager
def far_editor() -> Iterator[FarEditor]:
    """Start `colony lsp`, and end it with the test."""
    command = [sys.executable, "-m", "colony.cli.main", "lsp", "--stdio"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        try:
            yield FarEditor(process)
        finally:
            process.kill()
