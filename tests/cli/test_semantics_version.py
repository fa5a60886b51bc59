"""Recordings, compiled programs and JSON name their version of the semantics; others are refused."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.data_stream import RecordBuilder
from mcap.records import Metadata
from mcap.stream_reader import StreamReader

from colony.ir.version import SEMANTICS
from colony.library import audit, load, recorded
from colony.runtime.recordings.lines import add_checksum
from colony.runtime.recordings.mcap_writer import CHECKSUM, METADATA, checksum
from tests.cli.conftest import Colony
from tests.cli.run.test_run import MAP, ROAM
from tests.diagnostics import problems_of

OTHER = SEMANTICS + 1


@pytest.fixture
def record(colony: Colony, tmp_path: Path) -> Callable[[str], None]:
    """Records a short run of `roam.colony`."""
    (tmp_path / "roam.colony").write_text(ROAM)

    def run(name: str) -> None:
        colony.output("run", "roam.colony", "--map", MAP, "--no-picture", "--duration", "1", "--record", name)

    return run


def with_version(mcap: bytes, version: str | None) -> bytes:
    """The same MCAP, of another version, with the right checksum; None as before there were versions."""
    (found,) = [
        record
        for record in StreamReader(io.BytesIO(mcap)).records
        if isinstance(record, Metadata) and record.name == METADATA
    ]
    members = {name: value for name, value in found.metadata.items() if name not in ("semantics", CHECKSUM)}
    members |= {} if version is None else {"semantics": version}
    return mcap.replace(
        bytes_of(found), bytes_of(Metadata(METADATA, members | {CHECKSUM: checksum(members)}))
    )


def bytes_of(metadata: Metadata) -> bytes:
    builder = RecordBuilder()
    metadata.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def lines_of_version(lines: str, version: int | None) -> str:
    """The same lines, of another version, with the right checksums."""
    out = []
    for line in lines.splitlines():
        text, _, _ = line.rpartition(', "@sum"')
        member = "" if version is None else f', "@semantics": {version}'
        assert f', "@semantics": {SEMANTICS}' in text
        out.append(add_checksum(text.replace(f', "@semantics": {SEMANTICS}', member)))
    return "\n".join(out) + "\n"


@pytest.mark.parametrize("version", [None, OTHER])
@pytest.mark.parametrize("name", ["run.mcap", "run.jsonl"])
def test_audit_and_trace_refuse_a_recording_of_another_version(
    colony: Colony, record: Callable[[str], None], name: str, version: int | None
) -> None:
    record(name)
    assert colony("audit", name, "roam.colony").code == 0
    path = Path(name)
    if name == "run.mcap":
        path.write_bytes(with_version(path.read_bytes(), None if version is None else str(version)))
    else:
        path.write_text(lines_of_version(path.read_text(), version))
    found = f"the recording is of version {version or 1} of the semantics"
    said = f"error[A007]: {found}; this is version {SEMANTICS}"
    trace = ("trace", "roam.colony", "--input", name, "--backend")
    for arguments in (
        ("audit", name, "roam.colony"),
        *([("audit", name)] if name == "run.mcap" else []),
        *((*trace, backend) for backend in ("network", "clients", "python")),
    ):
        err = colony.one_line(*arguments)
        assert err.startswith(f"{name}:1:")
        assert said in err
        assert "record the run again" in err
    program = load("roam.colony")
    for read in (lambda: list(recorded(name, program)), lambda: audit(name, program)):
        assert problems_of(read)[0].code == "A007"


def test_a_version_that_is_no_number_is_malformed(colony: Colony, record: Callable[[str], None]) -> None:
    record("run.mcap")
    Path("run.mcap").write_bytes(with_version(Path("run.mcap").read_bytes(), "two"))
    assert "error[A002]: its metadata is malformed" in colony.refusal("audit", "run.mcap")


def test_a_compiled_program_of_another_version_is_refused(colony: Colony, behavior: Path) -> None:
    assert colony("compile", behavior, "-o", "b.colonyc").code == 0
    data = Path("b.colonyc").read_bytes()
    assert data[8] == SEMANTICS
    Path("b.colonyc").write_bytes(data[:8] + bytes([OTHER]) + data[9:])
    err = colony.one_line("run", "b.colonyc", "--map", MAP)
    assert f"of version {OTHER} of the semantics; this is version {SEMANTICS}; compile it again" in err


def test_clients_in_json_of_another_version_are_refused(colony: Colony, behavior: Path) -> None:
    assert colony("compile", behavior, "--format", "json", "-o", "b.json").code == 0
    assert colony("compile", behavior, "--prove", "b.json").code == 0
    text = Path("b.json").read_text()
    Path("b.json").write_text(text.replace(f'"semantics": {SEMANTICS}', f'"semantics": {OTHER}'))
    code, _, err = colony("compile", behavior, "--prove", "b.json")
    assert code != 0
    assert f"clients of version {OTHER} of the semantics" in err
    assert f"version {SEMANTICS}: compile them again" in err


@pytest.mark.parametrize(
    "arguments",
    [
        ("compile", "b.colony", "--format", "json"),
        ("verify", "b.colony", "--format", "json"),
        ("diff", "b.colony", "b.colony", "--format", "json"),
    ],
)
def test_json_says_its_version(colony: Colony, behavior: Path, arguments: tuple[str, ...]) -> None:
    assert behavior.name == "b.colony"
    assert json.loads(colony(*arguments).out)["semantics"] == SEMANTICS


def test_json_of_an_audit_says_its_version(colony: Colony, record: Callable[[str], None]) -> None:
    record("run.mcap")
    assert json.loads(colony("audit", "run.mcap", "--format", "json").out)["semantics"] == SEMANTICS


def test_generated_python_says_its_version(colony: Colony, behavior: Path) -> None:
    out = colony("compile", behavior, "--format", "python").out
    assert f"semantics version {SEMANTICS}." in out.splitlines()[0]
