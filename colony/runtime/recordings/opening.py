"""Opening of recordings in either format, detected by content."""

from __future__ import annotations

from io import BufferedReader
from typing import BinaryIO, NoReturn

from colony.files import open_regular, reason
from colony.ir.site import Site
from colony.runtime.recordings.reader import MAGIC, FramesReader, LinesReader
from colony.runtime.recordings.recorded import RecordingReader
from colony.runtime.recordings.replay import CHECKSUM_PREFIX, site_of_lines
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import Source, Span

_HEAD_BYTES = 64 * 1024
"""Number of leading bytes searched for a checksum, which identifies JSON lines with a damaged beginning."""


def open_recording(path: str) -> BinaryIO:
    """Open the file of a recording.

    Raises:
        DiagnosticError: A001, the file cannot be read.
    """
    try:
        return open_regular(path)
    except OSError as problem:
        _raise_unreadable(path, reason(problem))


def read_frames(file: BinaryIO, name: str) -> RecordingReader:
    """Return a reader of input frames from an MCAP recording or JSON lines, recorded or not.

    Raises:
        DiagnosticError: A002, the file is not a recording; A006, the part before its frames is damaged; A007,
            it is of another version of the semantics.
    """
    head = file.peek(len(MAGIC)) if isinstance(file, BufferedReader) else b""
    _expect_unpacked(head, name)
    if head.startswith(MAGIC):
        from colony.runtime.recordings.mcap_reader import McapReader

        return McapReader(file, name)
    return FramesReader(file, name)


def recorded_site(reader: RecordingReader, file: BinaryIO) -> Site | None:
    """Return the params of a site in a recording that is at its beginning; None if it has none."""
    if reader.run is not None:
        return reader.run.site
    try:
        return site_of_lines(file)
    except OSError:  # reported where its frames are read
        return None
    finally:
        file.seek(0)


def _raise_unreadable(path: str, why: str) -> NoReturn:
    raise DiagnosticError([error("A001", Span(Source(path, ""), 0, 0), f"cannot read the recording: {why}")])


_PACKED = {
    b"\x1f\x8b": "gunzip",
    b"\x28\xb5\x2f\xfd": "unzstd",
    b"\x04\x22\x4d\x18": "unlz4",
    b"BZh": "bunzip2",
    b"\xfd7zXZ\x00": "unxz",
    b"PK\x03\x04": "unzip",
}
"""First bytes of packed files, with the command that unpacks them."""


def _expect_unpacked(head: bytes, name: str) -> None:
    for magic, unpack in _PACKED.items():
        if head.startswith(magic):
            message = "this is a packed file, not a recording"
            raise DiagnosticError(
                [error("A002", Span(Source(name, ""), 0, 0), message, f"unpack it: `{unpack}`")]
            )


def read_recording(file: BinaryIO, name: str) -> RecordingReader:
    """Return the reader of a recording in either format; the beginning of JSON lines may be damaged.

    Raises:
        DiagnosticError: A001, the file cannot be read; A002, it is not a recording, or is packed; A007, it is
            of another version of the semantics.
    """
    try:
        head = file.read(_HEAD_BYTES)
        file.seek(0)
    except OSError as problem:
        _raise_unreadable(name, reason(problem))
    _expect_unpacked(head, name)
    if not head:
        raise DiagnosticError([error("A002", Span(Source(name, ""), 0, 0), "the recording is empty")])
    if head.startswith(MAGIC):
        from colony.runtime.recordings.mcap_reader import McapReader

        return McapReader(file, name)
    if head.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"") or CHECKSUM_PREFIX in head:
        return LinesReader(file, name)
    message = "this is not a recording: neither MCAP nor JSON lines"
    raise DiagnosticError([error("A002", Span(Source(name, ""), 0, 0), message)])
