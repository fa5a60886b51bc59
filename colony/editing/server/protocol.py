"""Messages of the Language Server Protocol 3.17, as far as the server reads and sends them.

Names of fields are the protocol's, in camel case on the wire. A message is a header `Content-Length: N`, an
empty line, and N bytes of JSON.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import UNSET, Raw, Struct, UnsetType

from colony.editing.text import TextPosition, TextRange

MAX_BYTES = 64 * 1024 * 1024
"""Byte limit of a message."""

PARSE_ERROR, INVALID_REQUEST, UNKNOWN_METHOD, INVALID_PARAMS = -32700, -32600, -32601, -32602
NOT_INITIALIZED, REQUEST_FAILED, CONTENT_MODIFIED = -32002, -32803, -32801

_MAX_DIGITS = 20
"""Characters of a length that are read; any number so long is more than `MAX_BYTES`."""


class ProtocolError(Exception):
    """The other side sends no messages of the protocol."""


class RequestError(Exception):
    """A request is refused: the code of the protocol, and why."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


class EditorMessage(Struct):
    """A request (`id` and `method`), a notification (`method`), or an answer (`id`)."""

    id: int | str | UnsetType | None = UNSET
    method: str = ""
    params: Raw = Raw(b"null")
    result: Raw = Raw(b"null")


class Framing:
    """Takes bytes, gives messages. Stateful: keeps the bytes of a message that is not complete."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield the complete messages so far.

        Raises:
            ProtocolError: A header is malformed, or a message is too long.
        """
        self._bytes += data
        while (end := self._bytes.find(b"\r\n\r\n")) >= 0:
            length = None
            for line in bytes(self._bytes[:end]).split(b"\r\n"):
                name, _, value = line.partition(b":")
                digits = value.strip()
                if name.strip().lower() == b"content-length" and digits.isdigit():
                    length = int(digits[:_MAX_DIGITS])
            if length is None or length > MAX_BYTES:
                raise ProtocolError("a message without a usable Content-Length")
            if len(self._bytes) < end + 4 + length:
                return
            yield bytes(self._bytes[end + 4 : end + 4 + length])
            del self._bytes[: end + 4 + length]
        if len(self._bytes) > MAX_BYTES:
            raise ProtocolError("a message that is too long")


def framed(body: object) -> bytes:
    """Return a message as bytes."""
    data = msgspec.json.encode(body)
    return b"Content-Length: %d\r\n\r\n" % len(data) + data


def answer(id_: object, result: object) -> bytes:
    """Return the answer to a request."""
    return framed({"jsonrpc": "2.0", "id": id_, "result": result})


def failure(id_: object, code: int, message: str) -> bytes:
    """Return the refusal of a request."""
    return framed({"jsonrpc": "2.0", "id": id_, "error": {"code": code, "message": message}})


def notification(method: str, params: object) -> bytes:
    """Return a notification."""
    return framed({"jsonrpc": "2.0", "method": method, "params": params})


def request(id_: int, method: str, params: object) -> bytes:
    """Return a request."""
    return framed({"jsonrpc": "2.0", "id": id_, "method": method, "params": params})


# --- what the server reads ----------------------------------------------------------------------------


class DocumentName(Struct):
    """The name of a document."""

    uri: str


class DocumentItem(Struct):
    """A document that was opened."""

    uri: str
    text: str
    version: int = 0


class VersionedName(Struct):
    """The name of a document, with the version that it has after a change."""

    uri: str
    version: int | None = None


class ContentChange(Struct):
    """New text for a range, or for the whole document."""

    text: str
    range: TextRange | None = None


class OpenParams(Struct, rename="camel"):
    """Parameters of `textDocument/didOpen`."""

    text_document: DocumentItem


class ChangeParams(Struct, rename="camel"):
    """Parameters of `textDocument/didChange`."""

    text_document: VersionedName
    content_changes: list[ContentChange]


class DocumentParams(Struct, rename="camel"):
    """Parameters of requests about a document."""

    text_document: DocumentName


class PositionParams(Struct, rename="camel"):
    """Parameters of requests about a place; `new_name` only of a rename."""

    text_document: DocumentName
    position: TextPosition
    new_name: str = ""
    context: Any = None


class RangeParams(Struct, rename="camel"):
    """Parameters of requests about a range."""

    text_document: DocumentName
    range: TextRange


class SymbolParams(Struct):
    """Parameters of `workspace/symbol`."""

    query: str = ""


class CommandParams(Struct):
    """Parameters of `workspace/executeCommand`."""

    command: str
    arguments: list[str] = []


class FolderItem(Struct):
    """A folder of the workspace."""

    uri: str
    name: str = ""


class Settings(Struct, rename="camel"):
    """What a user may set, as `initializationOptions` or as the section `colony` of the configuration.

    Attributes:
        prove: Whether contracts are proved, and tests run, behind a pause.
        seconds: About how much work all contracts of a file may take.
        robot: The description for `import robot`; "" for that of the project.
        hints: Whether inlay hints are shown.
    """

    prove: bool = True
    seconds: float = 20.0
    robot: str = ""
    hints: bool = True


class ConfigurationParams(Struct):
    """Parameters of `workspace/didChangeConfiguration`."""

    settings: Any = None


class InitializeParams(Struct, rename="camel"):
    """Parameters of `initialize`."""

    root_uri: str | None = None
    workspace_folders: list[FolderItem] | None = None
    initialization_options: Any = None
    capabilities: Any = None


# --- what the server sends ----------------------------------------------------------------------------


class Location(Struct, gc=False):
    """A range of a document."""

    uri: str
    range: TextRange


class TextEdit(Struct, rename="camel"):
    """New text for a range."""

    range: TextRange
    new_text: str


class EditorCommand(Struct):
    """A command that an editor may ask the server to run; one without a name is only shown."""

    title: str
    command: str = ""
    arguments: list[str] = []


class CodeLens(Struct):
    """A line above a line of the document."""

    range: TextRange
    command: EditorCommand


class DocumentSymbol(Struct, rename="camel"):
    """A declaration in the outline of a document."""

    name: str
    kind: int
    range: TextRange
    selection_range: TextRange
    detail: str = ""
    children: list[DocumentSymbol] = []


class CompletionItem(Struct, rename="camel", omit_defaults=True):
    """Something to write."""

    label: str
    kind: int
    detail: str = ""
    sort_text: str = ""
    insert_text: str = ""
    insert_text_format: int = 1
    documentation: str = ""
