"""The public functions of `import colony`: checking, compiling, proving, and reading recordings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf
from os import PathLike
from reprlib import repr as short_repr
from typing import TYPE_CHECKING

from colony.extras import install_command, installed, naming_missing_extras
from colony.shipped import Shipped
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import NOWHERE

if TYPE_CHECKING:
    from colony.analysis.report import AuditReport
    from colony.compile.backends.c.generate import CText
    from colony.compile.backends.c.native import CheckedCExecutor
    from colony.compile.pipeline import Compilation
    from colony.dsl.site import SiteParams
    from colony.execute.checked import CheckedExecutor
    from colony.execute.compiled import Compiled
    from colony.ir.program import Program
    from colony.runtime.frames.run_frame import RunFrame
    from colony.verify.contracts.results import Result as ContractResult
    from colony.verify.difference.results import Result as Difference

Params = str | PathLike[str] | Mapping[str, object]
"""Values of params: the path of a TOML file, or a mapping of names to values, or to further such mappings."""

PROOF_TIMEOUT_S = 60.0
"""Timeout of z3 in seconds for one question of a proof."""


def load(
    path: str | PathLike[str],
    *,
    robot: str | PathLike[str] | None = None,
    params: Params | None = None,
) -> Program:
    """Check the file at `path`, with everything that it imports, and return its program.

    Args:
        path: The file, or the name of a behavior that comes with colony: `wander`.
        robot: The description that `import robot` brings in, by its name or path. By default it is that of
            the
            project: `robot` in the nearest colony.toml.
        params: Values of params in place of those in the text: the path of a TOML file, or a mapping such as
            `{"cruising": "250 mm/s", "avoid": {"clearance": "0.7 m"}}`.

    Raises:
        DiagnosticError: there are errors; it has all diagnostics, warnings included.
    """
    from colony.dsl.load import load_file

    _expect_path(path)
    return load_file(Shipped.BEHAVIOR.find(str(path)), robot=_description(robot), params=_site(params))


def loads(
    text: str,
    name: str = "<text>",
    directory: str | PathLike[str] = ".",
    *,
    robot: str | PathLike[str] | None = None,
    params: Params | None = None,
) -> Program:
    """Check a text and return its program; messages call it `name`, imports are relative to `directory`.

    `robot` is the description that `import robot` brings in, by its name or path: a text has no project.
    `params` are as in `load`.

    Raises:
        DiagnosticError: there are errors; it has all diagnostics, warnings included.
    """
    from colony.dsl.load import load_text

    _expect(text, str, "the text of a behavior; `load` takes the path of a file")
    _expect(name, str, "the name of a text")
    _expect_path(directory)
    return load_text(text, name, str(directory), robot=_description(robot), params=_site(params))


def _site(params: Params | None) -> SiteParams | None:
    if params is None:
        return None
    from colony.dsl.site_reading import params_from_values, read_params

    _expect(params, (str, PathLike, Mapping), "the path of a TOML file, or a mapping of names to values")
    if isinstance(params, Mapping):
        return params_from_values(params, "<params>")
    return read_params(str(params))


def _description(robot: str | PathLike[str] | None) -> str | None:
    if robot is not None:
        _expect_path(robot)
    return None if robot is None else str(robot)


def build(program: Program, *, proof: bool = True, timeout_s: float = PROOF_TIMEOUT_S) -> Build:
    """Compile a program to prioritized clients, and prove them equivalent to its network.

    Without z3 the proof is by structure alone; a warning lists the open questions.

    Args:
        program: the result of `load` or `loads`.
        proof: False to skip the proof, which takes a fraction of a second for a hundred modules.
        timeout_s: limit of z3 for one question in seconds, which are counted in its steps.

    Raises:
        DiagnosticError: V001, the clients differ from the network (a bug in the compiler); V002, the proof
            was not decided within the limit.
    """
    from warnings import warn

    from colony.ir.program import expect_program
    from colony.runs.compiled import compiled_with_sources

    expect_program(program)
    _expect_number("timeout_s", timeout_s)
    compilation = compiled_with_sources(program, warn)
    if proof:
        _expect_proof(program, compilation, timeout_s)
    return Build(program=program, compilation=compilation)


def _expect_proof(program: Program, compilation: Compilation, seconds: float) -> None:
    from warnings import warn

    from colony.verify.equivalence import results
    from colony.verify.equivalence.prove import prove as prove_clients

    seconds = seconds if installed("z3") else 0
    match prove_clients(program, compilation, sent=lambda: compilation.compiled, seconds=seconds):
        case results.EquivalenceProved():
            return
        case results.EquivalenceUndecided() as undecided if not installed("z3"):
            warn(f"{results.undecided_text(undecided)}; {install_command('verify')}", stacklevel=3)
        case results.EquivalenceUndecided() as undecided:
            raise DiagnosticError([error("V002", NOWHERE, results.undecided_text(undecided))])
        case wrong:
            raise DiagnosticError([error("V001", NOWHERE, results.counterexample_text(wrong))])


def read(path: str | PathLike[str]) -> CompiledProgram:
    """Read a compiled program that `Build.save` or `colony compile -o NAME.colonyc` wrote.

    Raises:
        DiagnosticError: C001, the file cannot be read, is damaged, or the Python modules found now differ
            from those at compile time.
    """
    from colony.runs.compiled import read_compiled

    _expect_path(path)
    return CompiledProgram(read_compiled(path))


@dataclass(frozen=True, slots=True)
class CProgram:
    """A program in C99. `text` has its `name`, `header` and `source`."""

    text: CText

    def executor(self) -> CheckedCExecutor:
        """Return an executor with initial memory; the C is compiled once, and kept in the user's cache.

        Raises:
            MissingExtraError: cffi is not installed.
            NoCompilerError: there is no C compiler, or it failed.
        """
        from colony.compile.backends.c.native import CheckedCExecutor, built

        return CheckedCExecutor(self.text, built(self.text))


@dataclass(frozen=True, slots=True)
class CompiledProgram:
    """A compiled program without its source network. `compiled` is its executable form."""

    compiled: Compiled

    def to_python(self) -> str:
        """Return the source of a Python module with a class `Program`, which does not depend on colony.

        `Program().step(t_ns, readings, taken_ns)` decides a frame, as `executor().step` does.
        """
        from colony.compile.backends.python.generate import generate

        return generate(self.compiled)

    def to_c(self, name: str = "") -> CProgram:
        """Return a header and a source in C99, called `name`, by default like the robot.

        The `executor()` of the result compiles it, and takes frames as that of `executor` does.

        Raises:
            DiagnosticError: C002, the program has a module in Python.
        """
        from colony.compile.backends.c.generate import generate_c

        return CProgram(generate_c(self.compiled, name))

    def executor(self) -> CheckedExecutor:
        """Return an executor with initial memory, whose `step` takes one frame after another.

        Raises:
            DiagnosticError: P001, a Python module cannot be imported or built.
        """
        from colony.execute.checked import CheckedExecutor

        return CheckedExecutor(self.compiled)


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """A compiled program in all its forms. `compilation` has the result of each compiler pass."""

    program: Program
    compilation: Compilation

    def table(self) -> str:
        """Return the clients as a table for people: priorities and guards."""
        from colony.compile.backends.table import client_table

        return client_table(self.compilation)

    def to_json(self) -> str:
        """Return the clients in the form `colony-clients/1`."""
        from colony.compile.backends.json import to_json

        return to_json(self.compilation.clients, self.compilation.network.failsafe_modules)

    def to_python(self) -> str:
        """Return the source of a Python module; see `CompiledProgram.to_python`."""
        return CompiledProgram(self.compilation.compiled).to_python()

    def to_c(self, name: str = "") -> CProgram:
        """Return the program in C; see `CompiledProgram.to_c`."""
        return CompiledProgram(self.compilation.compiled).to_c(name)

    def graph(self) -> str:
        """Return the network as an SVG picture."""
        from colony.view.graph.graph import to_svg

        with naming_missing_extras():
            return to_svg(self.program)

    def executor(self) -> CheckedExecutor:
        """Return an executor; see `CompiledProgram.executor`."""
        return CompiledProgram(self.compilation.compiled).executor()

    def save(self, path: str | PathLike[str]) -> None:
        """Write the compiled program, with its sources, to a file for `read` and `colony run`.

        Raises:
            ValueError: the name of the file does not end in `.colonyc`.
            DiagnosticError: C001, the file could not be read back: a name or an array in the program is too
                long.
            OSError: the file cannot be written.
        """
        from pathlib import Path

        from colony.execute.colonyc import SUFFIX, decode, encode

        _expect_path(path)
        if Path(path).suffix != SUFFIX:
            raise ValueError(f"found {str(path)!r}; expected the name of a file that ends in {SUFFIX}")
        data = encode(self.compilation.compiled)
        decode(data, str(path))
        Path(path).write_bytes(data)


def prove(program: Program, *, seconds: float = 10.0, depth: int = 4) -> tuple[ContractResult, ...]:
    """Prove each contract for all possible sensor values, or find the shortest run that breaks it.

    Args:
        program: the result of `load` or `loads`.
        seconds: approximate time limit for each contract.
        depth: the maximum k of k-induction.

    Returns:
        A `Proved`, `ProvedInTime`, `Refuted` or `Unknown` (of `colony.verify.contracts.results`) for each
        contract, in the order of the source.
    """
    from colony.ir.program import expect_program

    with naming_missing_extras():
        from colony.verify.contracts.prove import prove_contracts
        from colony.verify.contracts.results import ProofOptions

    expect_program(program)
    _expect_number("seconds", seconds)
    _expect(depth, int, "the maximum k of k-induction, a whole number")
    return prove_contracts(program, ProofOptions.within(seconds, depth=depth))


def compare(one: Program, other: Program) -> Difference:
    """Prove that two programs send the same commands in every frame, or find a frame where they differ.

    Returns:
        A `Same`, `Different` or `Undecided` of `colony.verify.difference.results`.

    Raises:
        DiagnosticError: V040 to V042, the programs cannot be compared.
    """
    from colony.ir.program import expect_program

    with naming_missing_extras():
        from colony.verify.difference.compare import difference

    expect_program(one)
    expect_program(other)
    return difference(one, other)


def recorded(path: str | PathLike[str], program: Program) -> Iterator[RunFrame]:
    """Yield the undamaged frames of a recording, each with its verdicts.

    Raises:
        DiagnosticError: codes A and F, the file is not a recording, or is one of another program.
    """
    from colony.ir.program import expect_program

    _expect_path(path)
    expect_program(program)
    return _recorded(path, program)


def _recorded(path: str | PathLike[str], program: Program) -> Iterator[RunFrame]:
    from colony.analysis.recording import OpenRecording

    with OpenRecording.at(path) as recording:
        yield from recording.reader.frames(program)


def audit(path: str | PathLike[str], program: Program) -> AuditReport:
    """Decide every frame of a recording again with the reference interpreter, and report the differences.

    Raises:
        DiagnosticError: codes A and F, the file is not a recording, or is one of another program.
    """
    from colony.analysis.audit import audit_recording
    from colony.analysis.recording import OpenRecording
    from colony.ir.program import expect_program

    _expect_path(path)
    expect_program(program)
    with OpenRecording.at(path) as recording:
        return audit_recording(program, recording.reader)


# --- checks of arguments -----------------------------------------------------------------------------------


def _expect(value: object, kind: type | tuple[type, ...], expected: str) -> None:
    if not isinstance(value, kind):
        raise TypeError(f"found {short_repr(value)}; expected {expected}")


def _expect_path(value: object) -> None:
    _expect(value, (str, PathLike), "the path of a file or folder")


def _expect_number(name: str, value: float) -> None:
    _expect(value, (int, float), f"{name}, a number")
    if not 0 <= value < inf:
        raise ValueError(f"{name}: found {value}; expected 0 or more")
