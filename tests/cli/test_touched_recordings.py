"""Recordings that other tools cut, joined, sorted, packed or damaged: what each command makes of them."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
from collections.abc import Callable, Iterator
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from colony.dsl.files import read_source
from colony.dsl.load import load_text
from colony.execute.compiled import SourceFile
from tests.analysis.recorded_runs import as_mcap, logs
from tests.cli.mutants import TEXTS, Case, cases, read
from tests.runtime.recordings.mcap_files import trace

MS = 1_000_000


def rewritten(
    data: bytes, chosen: Callable[[list[Message], dict[int, str]], Iterator[Message]], *, chunked: bool = True
) -> bytes:
    """Return a recording as another tool writes it, with the messages that it chooses, in its order."""
    records: list[McapRecord] = list(StreamReader(io.BytesIO(data)).records)
    out, ids = io.BytesIO(), dict[int, int]()
    writer = Writer(out, use_chunking=chunked, chunk_size=2000)
    writer.start()
    for metadata in (r for r in records if isinstance(r, Metadata)):
        writer.add_metadata(metadata.name, metadata.metadata)
    for a in (r for r in records if isinstance(r, Attachment)):
        writer.add_attachment(0, 0, a.name, a.media_type, a.data)
    schemas = {r.id: r for r in records if isinstance(r, Schema)}
    channels = {r.id: r for r in records if isinstance(r, Channel)}
    for number, channel in channels.items():
        schema = schemas[channel.schema_id]
        schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
        ids[number] = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
    messages = [r for r in records if isinstance(r, Message)]
    for m in chosen(messages, {i: channel.topic for i, channel in channels.items()}):
        writer.add_message(ids[m.channel_id], m.log_time, m.data, m.publish_time, m.sequence)
    writer.finish()
    return out.getvalue()


def from_250_ms_on(data: bytes) -> bytes:
    return rewritten(data, lambda messages, _: (m for m in messages if m.log_time >= 250 * MS))


def topic_after_topic(data: bytes) -> bytes:
    return rewritten(
        data, lambda messages, topics: iter(sorted(messages, key=lambda m: topics[m.channel_id]))
    )


def by_time_and_topic(data: bytes) -> bytes:
    return rewritten(
        data,
        lambda messages, topics: iter(sorted(messages, key=lambda m: (m.log_time, topics[m.channel_id]))),
    )


def without_chunks(data: bytes) -> bytes:
    return rewritten(data, lambda messages, _: iter(messages), chunked=False)


def in_the_program(data: bytes) -> bytes:
    at = data.index(b"module back")
    return data[:at] + b"M" + data[at + 1 :]


MCAP: dict[str, tuple[Callable[[bytes], bytes], str | None, bool]] = {
    "cut": (from_250_ms_on, "it begins in the middle of a run, with frame 5", True),
    "joined": (lambda data: data + data[8:], "bytes after the end of the recording: left out", True),
    "random bytes after it": (
        lambda data: data + bytes(5000),
        "5000 bytes after the end of the recording",
        True,
    ),
    "sorted by time and topic": (by_time_and_topic, None, True),
    "topic after topic": (topic_after_topic, "not in the order of time", False),
    "without chunks": (without_chunks, "outside chunks", False),
    "damaged program": (in_the_program, "the program in it is damaged", True),
    "gzip": (gzip.compress, "unpack it: `gunzip`", False),
    "zstd": (zstandard.compress, "unpack it: `unzstd`", False),
    "lz4": (lz4.frame.compress, "unpack it: `unlz4`", False),
    "bzip2": (bz2.compress, "unpack it: `bunzip2`", False),
    "xz": (lzma.compress, "unpack it: `unxz`", False),
}
"""What a tool does to a recording, what is said of it, and whether its frames are read."""

COMMANDS = {
    "audit": ("audit", "{}", "b.colony"),
    "trace": ("trace", "b.colony", "--input", "{}"),
    "explain": ("explain", "{}", "b.colony", "--at", "0.3"),
    "watch": ("watch", "{}", "--behavior", "b.colony"),
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Case]]:
    """The recordings, and the folder of their behaviors."""
    folder = tmp_path_factory.mktemp("recordings")
    return folder, cases(folder)


@pytest.fixture
def recordings(made: tuple[Path, dict[str, Case]], monkeypatch: pytest.MonkeyPatch) -> dict[str, Case]:
    folder, recordings = made
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return recordings


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("change", MCAP)
def test_a_recording_that_another_tool_touched_is_read_or_named(
    recordings: dict[str, Case], change: str, command: str
) -> None:
    changed, said, is_read = MCAP[change]
    Path("x.mcap").write_bytes(changed(recordings["b.mcap"].content))
    code, text = read(COMMANDS[command], Path("x.mcap"))
    assert said is None or said in text
    is_shown_later = command == "watch" and change == "topic after topic"  # the page says it
    assert code == (0 if is_read or is_shown_later else 2), text
    if command == "audit" and is_read:
        assert "DIFFERS" not in text
        assert "agrees: every decision" in text


@pytest.mark.parametrize("command", COMMANDS)
def test_lines_cut_at_their_beginning_are_read_from_the_recorded_memory_on(
    recordings: dict[str, Case], command: str
) -> None:
    data = recordings["m.jsonl"].content
    Path("x.jsonl").write_bytes(b"".join(data.splitlines(keepends=True)[5:]))
    code, text = read(
        tuple(part.replace("b.colony", "m.colony") for part in COMMANDS[command]), Path("x.jsonl")
    )
    assert code == 0
    assert "it begins in the middle of a run, with frame 5" in text
    assert "DIFFERS" not in text


@pytest.mark.parametrize("path", ["/proc/self/environ", "{folder}/secret.colony", "../../secret.colony"])
def test_a_recorded_program_opens_no_file_outside_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret.colony").write_text("let x = 1\n")
    opened: list[str] = []

    def reading(name: Path, shown: str) -> object:
        opened.append(shown)
        return read_source(name, shown)

    monkeypatch.setattr("colony.dsl.files.read_source", reading)
    text = f'import "{path.format(folder=tmp_path)}"\n{TEXTS["b.colony"]}'
    behavior = load_text(TEXTS["b.colony"])
    source = SourceFile(kind="behavior", path="b.colony", data=text.encode())
    Path("x.mcap").write_bytes(as_mcap(behavior, logs(behavior, trace(3)), source).content)
    code, said = read(("audit", "{}"), Path("x.mcap"))
    assert (code, said.count("\n")) == (2, 1)
    assert "is not part of the recorded program" in said
    assert opened == ["b.colony"]
