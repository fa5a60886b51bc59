"""The language server as a process: the editor on standard input and output, and two workers on pipes."""

from __future__ import annotations

import os
import selectors
import subprocess
import sys
import time
from contextlib import suppress
from typing import IO

from colony.editing.server.jobs import Answer, Job, Unpacking, packed
from colony.editing.server.protocol import Framing, ProtocolError
from colony.editing.server.session import EditorSession

_CHUNK = 1 << 16


class WorkerProcess:
    """A worker, started when it gets its first job. Stateful."""

    def __init__(self, selector: selectors.BaseSelector) -> None:
        self._selector = selector
        self._process: subprocess.Popen[bytes] | None = None
        self._unpacking = Unpacking()

    def send(self, job: Job) -> None:
        """Give the worker a job; it has none that it is at work on."""
        if self._process is None:
            command = [sys.executable, "-m", "colony.editing.server.worker"]
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            self._unpacking = Unpacking()
            self._selector.register(self._pipe(self._process.stdout), selectors.EVENT_READ, self)
        pipe = self._pipe(self._process.stdin)
        with suppress(BrokenPipeError):  # its end is seen where answers are read
            pipe.write(packed(job))
            pipe.flush()

    @staticmethod
    def _pipe(pipe: IO[bytes] | None) -> IO[bytes]:
        assert pipe is not None, "both are pipes"
        return pipe

    def answers(self) -> list[Answer] | None:
        """Return the answers that are there; None if the worker died."""
        assert self._process is not None
        data = os.read(self._pipe(self._process.stdout).fileno(), _CHUNK)
        if not data:
            self.stop()
            return None
        return list(self._unpacking.feed(data, Answer))  # type: ignore[arg-type]

    def stop(self) -> None:
        """End the process, whatever it does."""
        if self._process is None:
            return
        self._selector.unregister(self._pipe(self._process.stdout))
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(BrokenPipeError):
                self._pipe(pipe).close()
        self._process = None


def serve(reading: int = 0, writing: int = 1) -> int:
    """Serve an editor until it leaves; return the exit code."""
    session, framing = EditorSession(), Framing()
    with selectors.SelectSelector() as selector:  # which takes a file for standard input, too
        selector.register(reading, selectors.EVENT_READ)
        analyzing, proving = WorkerProcess(selector), WorkerProcess(selector)
        try:
            while session.exit_code is None:
                deadline = session.deadline()
                wait = None if deadline is None else max(0.0, deadline - time.monotonic())
                for key, _ in selector.select(wait):
                    if isinstance(key.data, WorkerProcess):
                        _take(session, key.data, is_prover=key.data is proving)
                    elif not _read(session, framing, reading):
                        return session.exit_code or 0
                session.wake(time.monotonic())
                if session.proofs.stops:
                    session.proofs.stops = False
                    proving.stop()
                for job in session.jobs:
                    analyzing.send(job)
                for proof in session.proofs.jobs:
                    proving.send(proof)
                session.jobs.clear()
                session.proofs.jobs.clear()
                _write(writing, b"".join(session.out))
                session.out.clear()
            return session.exit_code
        except BrokenPipeError:  # the editor is gone
            return 1
        finally:
            analyzing.stop()
            proving.stop()


def _take(session: EditorSession, worker: WorkerProcess, *, is_prover: bool) -> None:
    answers = worker.answers()
    if answers is None:
        session.lost(time.monotonic(), is_prover=is_prover)
    for answer in answers or ():
        session.answered(answer, time.monotonic())


def _read(session: EditorSession, framing: Framing, reading: int) -> bool:
    """Handle what the editor sent; return False at its end."""
    data = os.read(reading, _CHUNK)
    if not data:
        return False
    try:
        for body in framing.feed(data):
            session.receive(body, time.monotonic())
    except ProtocolError as problem:
        print(f"colony lsp: {problem}", file=sys.stderr)
        session.exit_code = 1
        return False
    return True


def _write(descriptor: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]
