"""The language server without I/O: messages and answers of workers in, messages and jobs out.

A request is answered from the last index of its document, and never waits for a parse of the file. Two kinds
of requests do wait: any before the first index of a document, and `references`, `rename` and `formatting`,
which a worker answers. A change begins a pause; at its end the document is analyzed, and at the end of a
longer one its contracts are proved.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from itertools import count
from typing import Any

import msgspec
from msgspec import UNSET

from colony import __version__
from colony.dsl.parser import accepted_at
from colony.editing.features import margin, symbols
from colony.editing.features.renaming import new_name_problem, rename_edits
from colony.editing.index import Index
from colony.editing.open_file import path_of, uri_of
from colony.editing.server import protocol
from colony.editing.server.documents import ANALYZE_PAUSE_S, STALE, EditedFile
from colony.editing.server.jobs import (
    AnalyzeAnswer,
    AnalyzeJob,
    Answer,
    FormatAnswer,
    FormatJob,
    Job,
    ProofVerdict,
    ProveAnswer,
    UsesAnswer,
    UsesJob,
)
from colony.editing.server.methods import CAPABILITIES, COMMANDS, FEATURES, WATCHING
from colony.editing.server.proofs import ProofQueue
from colony.editing.server.worker import behavior_files
from colony.editing.text import Drift, Lines


class EditorSession:
    """One editor's session. Stateful.

    Attributes:
        out: Messages to send, as bytes; the caller empties it.
        jobs: Jobs for the worker that analyzes; the caller empties it.
        proofs: The proofs, with the jobs for the worker that proves.
        settings: What the user set.
        exit_code: The exit code, once the session is over.
    """

    def __init__(self) -> None:
        self.out: list[bytes] = []
        self.jobs: list[Job] = []
        self.exit_code: int | None = None
        self.settings = protocol.Settings()
        self._files: dict[str, EditedFile] = {}  # by real path
        self._by_uri: dict[str, EditedFile] = {}
        self._folders: list[str] = []
        self._capabilities: Any = {}
        self._initialized = self._shut_down = False
        self._next_number = count(1).__next__  # of jobs, and of requests to the editor
        self._busy: tuple[Job, EditedFile] | None = None
        self._asked: list[tuple[UsesJob | FormatJob, EditedFile, Any]] = []  # with the id of the request
        self._waiting: list[tuple[protocol.EditorMessage, EditedFile]] = []  # for a first index
        self.proofs = ProofQueue(self, self._files, self._next_number)

    # --- messages

    def receive(self, data: bytes, now: float) -> None:
        """Handle a message of the editor."""
        try:
            message = msgspec.json.decode(data, type=protocol.EditorMessage)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as problem:
            self.out.append(protocol.failure(None, protocol.PARSE_ERROR, str(problem)))
            return
        if message.method:
            self._handle(message, now)

    def _handle(self, message: protocol.EditorMessage, now: float) -> None:
        is_request = message.id is not UNSET
        try:
            result = self._dispatch(message, now)
        except (protocol.RequestError, msgspec.MsgspecError, RecursionError) as problem:
            code = problem.code if isinstance(problem, protocol.RequestError) else protocol.INVALID_PARAMS
            if is_request:
                self.out.append(protocol.failure(message.id, code, str(problem)))
            return
        if is_request and result is not _LATER:
            self.out.append(protocol.answer(message.id, result))

    def _dispatch(self, message: protocol.EditorMessage, now: float) -> Any:
        method = message.method
        if method == "exit":
            self.exit_code = 0 if self._shut_down else 1
            return None
        if not self._initialized and method != "initialize":
            raise protocol.RequestError(protocol.NOT_INITIALIZED, "the session is not initialized")
        if self._shut_down:
            raise protocol.RequestError(protocol.INVALID_REQUEST, "the session is shut down")
        if method in _SESSION:
            return _SESSION[method](self, message, now)
        if method not in FEATURES:
            if method.startswith("$/") or message.id is UNSET:
                return None
            raise protocol.RequestError(protocol.UNKNOWN_METHOD, f"no method `{method}`")
        type_, feature = FEATURES[method]
        params = msgspec.json.decode(message.params, type=type_)
        file = self._open(params.text_document.uri)
        if file.index is None:
            self._waiting.append((message, file))
            return _LATER
        return feature(self.settings, file, params)

    def _open(self, uri: str) -> EditedFile:
        file = self._by_uri.get(uri)
        if file is None:
            raise protocol.RequestError(protocol.INVALID_PARAMS, f"`{uri}` is not open")
        return file

    def notify(self, method: str, params: object) -> None:
        """Send a notification."""
        self.out.append(protocol.notification(method, params))

    def refresh(self, *kinds: str) -> None:
        """Have the editor ask again for what it draws, if it can."""
        for kind in kinds:
            if self._can("workspace", kind, "refreshSupport"):
                self._ask(f"workspace/{kind}/refresh", None)

    def _ask(self, method: str, params: object) -> None:
        """Send a request whose answer does not matter."""
        self.out.append(protocol.request(self._next_number(), method, params))

    def _can(self, *path: str) -> bool:
        """Return True if the editor has a capability."""
        found: Any = self._capabilities
        for name in path:
            found = found.get(name) if isinstance(found, dict) else None
        return bool(found)

    # --- life

    def _initialize(self, message: protocol.EditorMessage, now: float) -> Any:
        params = msgspec.json.decode(message.params, type=protocol.InitializeParams)
        folders = [folder.uri for folder in params.workspace_folders or ()]
        folders = folders or ([params.root_uri] if params.root_uri else [])
        self._folders = [_real_path(uri) for uri in folders]
        self._capabilities = params.capabilities
        self._set(params.initialization_options)
        self._initialized = True
        return {"capabilities": CAPABILITIES, "serverInfo": {"name": "colony", "version": __version__}}

    def _initialized_by(self, message: protocol.EditorMessage, now: float) -> None:
        """Load the grammar for the first completion; ask to hear of files that other programs change."""
        accepted_at("", 0, 0)
        if self._can("workspace", "didChangeWatchedFiles", "dynamicRegistration"):
            self._ask("client/registerCapability", WATCHING)

    def _set(self, settings: object) -> None:
        """Take on settings; those of a wrong type leave all as they were."""
        try:
            self.settings = msgspec.convert(settings or {}, protocol.Settings)
        except msgspec.ValidationError as problem:
            self._log(f"settings: {problem}")

    def _configure(self, message: protocol.EditorMessage, now: float) -> None:
        settings = msgspec.json.decode(message.params, type=protocol.ConfigurationParams).settings
        self._set(settings.get("colony", settings) if isinstance(settings, dict) else settings)
        self._touch_all(message, now)

    def _touch_all(self, message: protocol.EditorMessage, now: float) -> None:
        """Analyze all documents: files beside them have changed, or settings."""
        for file in self._files.values():
            self._touch(file, now)

    def _shutdown(self, message: protocol.EditorMessage, now: float) -> None:
        self.proofs.give_up()
        self._shut_down = True

    # --- documents

    def _did_open(self, message: protocol.EditorMessage, now: float) -> None:
        item = msgspec.json.decode(message.params, type=protocol.OpenParams).text_document
        path = _real_path(item.uri)
        file = EditedFile(item.uri, path, item.version, Lines(item.text), self._files)
        self._files[path] = self._by_uri[item.uri] = file
        self._touch(file, now - ANALYZE_PAUSE_S)

    def _did_change(self, message: protocol.EditorMessage, now: float) -> None:
        params = msgspec.json.decode(message.params, type=protocol.ChangeParams)
        file = self._open(params.text_document.uri)
        for change in params.content_changes:
            if change.range is None:
                file.replace(0, len(file.text), change.text)
            else:
                start, end = (file.lines.offset(p) for p in (change.range.start, change.range.end))
                file.replace(start, max(start, end), change.text)
        file.version = params.text_document.version or file.version + 1
        self._touch(file, now)

    def _touch(self, file: EditedFile, now: float) -> None:
        file.touch(now)
        self.proofs.give_up()

    def _did_close(self, message: protocol.EditorMessage, now: float) -> None:
        params = msgspec.json.decode(message.params, type=protocol.DocumentParams)
        file = self._by_uri.pop(params.text_document.uri, None)
        if file is None:
            return
        if self._files.get(file.path) is file:
            del self._files[file.path]
            for other in self._files.values():  # importers see what is on disk
                if other.index is None or other.known.file(file.path) is not None:
                    self._touch(other, now)
        for uri in sorted({*file.published, file.uri}):
            self.publish(uri)
        for message_, other in [w for w in self._waiting if w[1] is file]:
            self._waiting.remove((message_, other))
            why = "the document was closed"
            self.out.append(protocol.failure(message_.id, protocol.REQUEST_FAILED, why))

    # --- analysis

    def wake(self, now: float) -> None:
        """Begin what is due: an analysis, the search for a name, a proof."""
        if self._busy is None:
            due = [f for f in self._files.values() if f.analysis_due is not None and f.analysis_due <= now]
            if due:
                file = min(due, key=lambda f: (f.index is not None, f.waits_since or 0.0))
                file.changed_at = file.waits_since = None
                file.pending = Drift()
                job = AnalyzeJob(self._next_number(), file.program(self.settings.robot))
                self._busy = job, file
                self.jobs.append(job)
            elif self._asked:
                asked, file, _ = self._asked[0]
                self._busy = asked, file
                self.jobs.append(asked)
        self.proofs.wake(now)

    def deadline(self) -> float | None:
        """Return when `wake` has something to do next; None if nothing is planned."""
        times = [self.proofs.deadline()]
        if self._busy is None:
            times += [f.analysis_due for f in self._files.values()]
            times += [0.0] if self._asked else []
        return min((time for time in times if time is not None), default=None)

    def answered(self, answer: Answer, now: float) -> None:
        """Handle an answer of a worker; one to a job that was given up does not matter."""
        if isinstance(answer, ProofVerdict | ProveAnswer):
            self._log(answer.failed if isinstance(answer, ProveAnswer) else "")
            self.proofs.answered(answer)
            return
        if self._busy is None or self._busy[0].number != answer.number:
            return
        (_, file), self._busy = self._busy, None
        if isinstance(answer, AnalyzeAnswer):
            self._analyzed(file, answer, now)
        else:
            asked, file, id_ = self._asked.pop(0)
            try:
                self.out.append(protocol.answer(id_, self._result(asked, file, answer)))
            except protocol.RequestError as problem:
                self.out.append(protocol.failure(id_, problem.code, str(problem)))

    def lost(self, now: float, *, is_prover: bool) -> None:
        """Go on without the answer of a worker that died."""
        why = "the analysis died"
        if is_prover:
            self.proofs.lost()
        elif self._busy is not None:
            job, _ = self._busy
            if isinstance(job, UsesJob):
                self.answered(UsesAnswer(job.number, "", "", [], {}, why), now)
            elif isinstance(job, FormatJob):
                self.answered(FormatAnswer(job.number, "", why), now)
            else:
                self.answered(AnalyzeAnswer(job.number, Index(), why), now)

    def _log(self, text: str) -> None:
        if text:
            self.notify("window/logMessage", {"type": 1, "message": f"colony: {text}"})

    def _analyzed(self, file: EditedFile, answer: AnalyzeAnswer, now: float) -> None:
        self._log(answer.failed)
        if not answer.failed:
            file.index, file.drift = answer.index, file.pending
        elif file.index is None:
            file.index = Index()
        file.pending = Drift()
        if self._files.get(file.path) is not file:
            return
        before, file.published = file.published, {self._uri(f.path) for f in file.known.files} | {file.uri}
        for uri in sorted(before | file.published):
            self.publish(uri)
        if not file.known.is_valid and file.verdicts:
            file.proof_state = STALE
        for other in self._files.values():  # importers see the new text
            found = None if other is file else other.known.file(file.path)
            if found is not None and found[1].text != file.text and other.changed_at is None:
                other.touch(now)
        ready = [message for message, waiting in self._waiting if waiting is file]
        self._waiting = [w for w in self._waiting if w[1] is not file]
        for message in ready:
            self._handle(message, now)
        self.refresh("semanticTokens", "inlayHint", "codeLens")

    def _uri(self, path: str) -> str:
        file = self._files.get(path)
        return uri_of(path) if file is None else file.uri

    def publish(self, uri: str) -> None:
        """Send what is known of a document: the findings of all open programs that have it, each once."""
        path = os.path.realpath(path_of(uri))
        opened = self._files.get(path)
        rows: list[Any] = []
        for file in self._files.values():
            found = file.known.file(path)
            if found is not None:
                rows += margin.diagnostics(file.known, found[0], found[1].findings)
        if opened is not None and opened.proved_now:
            rows += margin.diagnostics(opened.known, opened.number, opened.proved_now)
        unique = [row for i, row in enumerate(rows) if row not in rows[:i]]
        version = {} if opened is None else {"version": opened.version}
        self.notify("textDocument/publishDiagnostics", {"uri": uri, "diagnostics": unique, **version})

    # --- uses of a name, formatting, commands, symbols

    def _find_uses(self, message: protocol.EditorMessage, now: float) -> Any:
        params = msgspec.json.decode(message.params, type=protocol.PositionParams)
        file = self._open(params.text_document.uri)
        problem = new_name_problem(params.new_name) if message.method == "textDocument/rename" else None
        if problem is not None:
            raise protocol.RequestError(protocol.REQUEST_FAILED, problem)
        program, offset = file.program(self.settings.robot), file.lines.offset(params.position)
        job = UsesJob(self._next_number(), program, offset, self._folders_of(file), params.new_name)
        self._asked.append((job, file, message.id))
        return _LATER

    def _format(self, message: protocol.EditorMessage, now: float) -> Any:
        params = msgspec.json.decode(message.params, type=protocol.DocumentParams)
        file = self._open(params.text_document.uri)
        self._asked.append((FormatJob(self._next_number(), file.path, file.text), file, message.id))
        return _LATER

    def _folders_of(self, file: EditedFile) -> list[str]:
        return self._folders or [os.path.dirname(file.path)]

    def _result(self, job: UsesJob | FormatJob, file: EditedFile, answer: UsesAnswer | FormatAnswer) -> Any:
        """Return the result of a request that a worker has answered, or refuse it."""
        if isinstance(job, FormatJob):
            opened = then = {job.path: job.text}
        else:
            opened, then = job.program.texts, answer.texts if isinstance(answer, UsesAnswer) else {}
        for path, text in then.items():
            now = self._files.get(path)
            if path in opened if now is None else now.text != text:
                why = f"`{path}` has changed meanwhile"
                raise protocol.RequestError(protocol.CONTENT_MODIFIED, why)
        if isinstance(job, UsesJob) and isinstance(answer, UsesAnswer) and job.new_name:
            edits = rename_edits(answer, job.new_name, self._folders_of(file))
            if isinstance(edits, str):
                raise protocol.RequestError(protocol.REQUEST_FAILED, edits)
            return self._workspace_edit(edits)
        if isinstance(answer, UsesAnswer):
            lines = {path: Lines(text) for path, text in answer.texts.items()}
            return [
                protocol.Location(self._uri(path), lines[path].range(start, end))
                for path, start, end in answer.uses
            ]
        if answer.refusal:
            raise protocol.RequestError(protocol.REQUEST_FAILED, answer.refusal)
        drift = Drift.between(file.text, answer.text)
        if drift.start < 0:
            return []
        place = file.lines.range(drift.start, drift.then)
        return [protocol.TextEdit(place, answer.text[drift.start : drift.now])]

    def _workspace_edit(self, edits: dict[str, list[protocol.TextEdit]]) -> Any:
        """Return edits by path as the protocol has them, with versions if the editor reads these."""
        if not self._can("workspace", "workspaceEdit", "documentChanges"):
            return {"changes": {self._uri(path): rows for path, rows in edits.items()}}
        changes: list[Any] = []
        for path, rows in edits.items():
            opened = self._files.get(path)
            name = {"uri": self._uri(path), "version": None if opened is None else opened.version}
            changes.append({"textDocument": name, "edits": rows})
        return {"documentChanges": changes}

    def _execute(self, message: protocol.EditorMessage, now: float) -> Any:
        params = msgspec.json.decode(message.params, type=protocol.CommandParams)
        if params.command not in COMMANDS or len(params.arguments) != 2:
            expected = f"expected one of {', '.join(COMMANDS)} with a URI and a name"
            raise protocol.RequestError(protocol.INVALID_PARAMS, expected)
        uri, name = params.arguments
        file = self._open(uri)
        if params.command == margin.RUN_TEST:
            self.proofs.add_test(file, name)
            return None
        verdict = file.verdicts.get(("contract", name))
        if verdict is None:
            raise protocol.RequestError(protocol.REQUEST_FAILED, f"nothing is known about `{name}` yet")
        if params.command == margin.SHOW_RUN:
            self.notify("window/showMessage", {"type": 3, "message": verdict.details})
            return {"title": name, "text": verdict.details}
        if not verdict.block:
            raise protocol.RequestError(protocol.REQUEST_FAILED, f"no test repeats the run of `{name}`")
        if verdict.number != file.proof_number:
            raise protocol.RequestError(protocol.REQUEST_FAILED, f"the verdict of `{name}` is from {STALE}")
        edit = self._workspace_edit({file.path: [margin.appended(file, verdict.block)]})
        self._ask("workspace/applyEdit", {"label": f"write the test of {name}", "edit": edit})
        return edit

    def _symbols(self, message: protocol.EditorMessage, now: float) -> Any:
        params = msgspec.json.decode(message.params, type=protocol.SymbolParams)
        return symbols.workspace_symbols(params.query, self._files.values(), behavior_files(self._folders))


def _real_path(uri: str) -> str:
    """Return the real path of a document or folder; refuse a URI that names none."""
    try:
        return os.path.realpath(path_of(uri))
    except ValueError as problem:  # a malformed host, a NUL
        raise protocol.RequestError(protocol.INVALID_PARAMS, f"`{uri}` names no file: {problem}") from problem


_LATER = object()
"""The result of a request that is answered later."""

_SESSION: dict[str, Callable[[EditorSession, protocol.EditorMessage, float], Any]] = {
    "initialize": EditorSession._initialize,
    "initialized": EditorSession._initialized_by,
    "shutdown": EditorSession._shutdown,
    "textDocument/didOpen": EditorSession._did_open,
    "textDocument/didChange": EditorSession._did_change,
    "textDocument/didClose": EditorSession._did_close,
    "workspace/didChangeWatchedFiles": EditorSession._touch_all,
    "workspace/didChangeConfiguration": EditorSession._configure,
    "workspace/symbol": EditorSession._symbols,
    "workspace/executeCommand": EditorSession._execute,
    "textDocument/references": EditorSession._find_uses,
    "textDocument/rename": EditorSession._find_uses,
    "textDocument/formatting": EditorSession._format,
}
"""By method, what a session does itself."""
