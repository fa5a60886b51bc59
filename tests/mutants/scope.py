"""What is mutated, and by which tests mutants are to be killed."""

from __future__ import annotations

import hashlib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

FRAMES = (
    *("frames/clock", "frames/registry", "frames/liveness", "frames/assembly", "frames/membership"),
    *("clients/client", "clients/memory"),
)
"""Ticks and epochs, who lives, frames put together from what arrives, what a client remembers."""

ARBITRATION = tuple(
    f"arbitration/{name}" for name in ("ballot", "arbiter", "outside", "locks", "stop_latch", "stop_file")
)
"""The rule, the protocol around it, leases, locks, the emergency stop."""

RUNTIME_TESTS = (
    *(
        "clock",
        "clock_bounds",
        "assembly",
        "assembly_bounds",
        "client",
        "client_bounds",
        "memory",
        "membership",
    ),
    *(
        "arbitration",
        "arbitration_bounds",
        "arbitration_promises",
        "outside",
        "locks",
        "latch",
        "right_of_way_bounds",
    ),
    *("conformance", "loss_policy", "observer", "virtual", "session", "session_faults"),
    *("rserver", "rserver_calls", "rserver_faults", "monitor", "publishing", "own_servers"),
)

TESTS: tuple[str, ...] = (
    "tests/compile",
    "tests/verify/test_agreement.py",
    "tests/verify/test_drawn_runs.py",
    "tests/verify/test_interpreter_frames.py",
    *(f"tests/runtime/test_{name}.py" for name in RUNTIME_TESTS),
)
"""Tests in this process and in virtual time only: sockets and processes of their own would take hours."""


SEEING_MOST = (
    "tests/compile/test_whole_code.py::test_case[",
    "tests/compile/test_whole_code.py::test_without",
    "tests/compile/test_explain_cut.py::test_a_large_network",
)
"""Tests that look at all of what the compiler makes: they are tried whatever they take."""


def modules() -> list[str]:
    """The paths of the modules that are mutated, from the root of the repository."""
    packages = (ROOT / "colony/compile", ROOT / "colony/execute")
    compiler = sorted(str(path.relative_to(ROOT)) for package in packages for path in package.rglob("*.py"))
    runtime = [f"colony/runtime/{name}.py" for name in FRAMES + ARBITRATION]
    return [*(path for path in compiler if (ROOT / path).stat().st_size), "colony/ir/frame.py", *runtime]


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
