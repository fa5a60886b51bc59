"""What is mutated, and by which tests mutants are to be killed."""

from __future__ import annotations

import hashlib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

FRAMES = ("frames/clock", "frames/registry", "frames/assembler", "clients/client")
"""Ticks and epochs, who lives, frames put together from what arrives, what a client remembers."""

ARBITRATION = tuple(
    f"arbitration/{name}" for name in ("ballot", "arbiter", "outside", "motion", "stop_latch")
)
"""The rule, the protocol around it, leases, locks, the emergency stop."""

RUNTIME_TESTS = (
    *(
        "frames/test_clock",
        "frames/test_clock_bounds",
        "frames/test_clock_stop",
        "frames/test_assembler",
        "frames/test_resumption",
    ),
    *("frames/test_membership", "clients/test_client", "clients/test_memory"),
    *("arbitration/test_arbiter", "arbitration/test_arbiter_bounds", "arbitration/test_promises"),
    *("arbitration/test_outside", "arbitration/test_locks", "arbitration/test_stop_latch"),
    *("assembly/test_conformance", "assembly/test_loss"),
    *("observe/test_observer", "observe/test_monitor", "transport/test_virtual"),
    *("assembly/test_virtual", "assembly/test_virtual_faults"),
    *("servers/test_rserver", "servers/test_rserver_calls", "servers/test_rserver_faults"),
    *("servers/test_commanded", "frames/test_publishing"),
)

TESTS: tuple[str, ...] = (
    *("tests/compile", "tests/execute", "tests/semantics"),
    *("tests/verify/testing/test_agreement.py", "tests/verify/testing/test_drawn_runs.py"),
    "tests/text/test_wording.py",
    *(f"tests/runtime/{name}.py" for name in RUNTIME_TESTS),
)
"""Tests in this process and in virtual time only: sockets and processes of their own would take hours."""


SEEING_MOST = (
    "tests/compile/test_whole_code.py::test_case[",
    "tests/compile/test_whole_code.py::test_without",
    "tests/compile/backends/test_explain.py::test_a_large_network",
)
"""Tests that look at all of what the compiler makes: they are tried whatever they take."""


def modules() -> list[str]:
    """The paths of the modules that are mutated, from the root of the repository."""
    packages = (ROOT / "colony/compile", ROOT / "colony/execute")
    compiler = sorted(str(path.relative_to(ROOT)) for package in packages for path in package.rglob("*.py"))
    runtime = [f"colony/runtime/{name}.py" for name in FRAMES + ARBITRATION]
    return [
        *(path for path in compiler if (ROOT / path).stat().st_size),
        "colony/ir/frame.py",
        "colony/text/wording.py",
        *runtime,
    ]


def tests() -> list[str]:
    """The files of tests, from the root of the repository."""
    found: list[Path] = []
    for path in map(ROOT.joinpath, TESTS):
        found += sorted(path.rglob("test_*.py")) if path.is_dir() else [path]
    return [str(path.relative_to(ROOT)) for path in found]


def digest(*paths: Path) -> str:
    """Of the texts of these files."""
    whole = hashlib.sha256()
    for path in sorted(paths):
        whole.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return whole.hexdigest()[:16]
