"""`colony compile`: the prioritized clients of a behavior, proved to be equivalent to its network."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, assert_never

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.outputs import BEHAVIOR, cannot_write, check_output, write_whole
from colony.cli.params_choice import chosen_params, params_option
from colony.cli.reporting import check_to_run, refuse, report, say
from colony.cli.robot_choice import description_option
from colony.cli.verify.prover_options import COUNTED, ProverSeconds
from colony.extras import expect_extras, install_command, installed, naming_missing_extras
from colony.files import read_file, reason
from colony.verify.interruption import reliable_interrupts

if TYPE_CHECKING:
    from colony.compile.pipeline import Compilation
    from colony.execute.compiled import Compiled
    from colony.ir.program import Program
    from colony.verify.equivalence.results import Result


CLIENTS_BYTES = 64 * 1024 * 1024
"""Size limit in bytes of a file of clients to prove."""


@click.command("compile", short_help="compile a behavior to prioritized clients")
@click.argument("file", metavar="FILE", type=BEHAVIOR)
@description_option()
@params_option()
@click.option(
    "--explain",
    is_flag=True,
    help="Show each step: sequences written out, inhibition eliminated, the tree, the order of visit.",
)
@click.option(
    "--format",
    "format_",
    type=click.Choice(["table", "json", "python", "c"]),
    default="table",
    show_default=True,
    help="A table for people, JSON for programs, a Python class that does not depend on colony, or a header "
    "and a source in C99, which need -o FOLDER.",
)
@click.option(
    "--float",
    "in_floats",
    is_flag=True,
    help="Write C with floats in the place of doubles. It is unproved: it may decide otherwise than FILE.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="PATH",
    help="The output file, or for C the folder of NAME.h and NAME.c. [default: standard output]",
)
@click.option(
    "--no-proof", is_flag=True, help="Do not prove that the clients are equivalent to the network of FILE."
)
@click.option(
    "--prove",
    "existing",
    metavar="CLIENTS",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Only prove existing clients (JSON, or Python in a .py file, or C in a .c file beside its header) "
    "equivalent to the network of FILE.",
)
@click.option(
    "--proof-timeout",
    type=ProverSeconds(allow_zero=True),
    default=60.0,
    show_default=True,
    metavar="SECONDS",
    help=f"The approximate time limit of z3 for one question; with 0 it is not used. {COUNTED}",
)
def command(
    file: str,
    explain: bool,
    format_: str,
    in_floats: bool,
    output: Path | None,
    no_proof: bool,
    existing: Path | None,
    proof_timeout: float,
) -> None:
    """Compile a behavior to prioritized clients: eliminate inhibition, then number the modules by a forward
    traversal.

    Whatever the modules do, clients and network have the same winner in every frame. This is proved before
    the result is shown. If the proof fails, nothing is shown, and the exit code is 1. Without z3 the proof is
    by structure alone, and a message lists the open questions.

    \b
    Example:
      colony compile wander
      colony compile --explain figure_4_14
      colony compile --format python wander -o wander.py
      colony compile --format c wander -o firmware
      colony compile wander -o wander.colonyc
      colony compile --prove wander.py wander

    With -o NAME.colonyc the output is the compiled program with its sources, which `colony run` takes in
    place of a behavior. With --params it has their values, and the contracts that are proved with them.
    """
    if explain and format_ != "table":
        raise click.UsageError("--explain requires --format table", click.get_current_context())
    if in_floats and format_ != "c":
        raise click.UsageError("--float requires --format c", click.get_current_context())
    if existing is not None:
        _expect_alone(explain or no_proof or output is not None or format_ != "table")
    from colony.cli.programs import compile_file
    from colony.execute.colonyc import SUFFIX, encode

    if output is not None:
        if output.suffix == SUFFIX and (explain or format_ != "table"):
            message = f"a {SUFFIX} file has its own format; leave out --format and --explain"
            raise click.UsageError(message, click.get_current_context())
        if format_ != "c":
            check_output(output, [file])
    if format_ == "c":
        output = _c_folder(output, file, no_proof or in_floats)

    compilation = compile_file(file)
    program = compilation.program
    seconds = proof_timeout if installed("z3") else 0
    if existing is not None:
        with reliable_interrupts():
            result = _proof_of(existing, program, compilation, seconds)
        _report_proof(result, program, clients_file=existing)
        return
    if format_ == "c":
        assert output is not None
        _write_c(compilation, file, output, None if no_proof else seconds, in_floats)
        return
    text = _text(compilation, format_, explain)
    if explain:
        text = _sequences(file) + text
    if not no_proof:
        with reliable_interrupts():
            result = _proof(compilation, format_, text, seconds)
        _report_proof(result, program, clients_file=None)
    if not text.endswith("\n"):
        text += "\n"
    if output is None:
        click.echo(text, nl=False)
    else:
        write_whole(output, encode(_proved(compilation, file, no_proof)) if output.suffix == SUFFIX else text)


def _expect_alone(others: bool) -> None:
    """Refuse `--prove` if `others`, options that it cannot be combined with, are given."""
    if others:
        message = "--prove can be combined only with --proof-timeout"
        raise click.UsageError(message, click.get_current_context())
    expect_extras("verify")


def _c_folder(folder: Path | None, file: str, no_proof: bool) -> Path:
    """Check the folder of C, and what its proof needs, before the work begins."""
    if folder is None:
        message = "--format c requires -o FOLDER, since it writes two files"
        raise click.UsageError(message, click.get_current_context())
    if not no_proof:
        expect_extras("native")
    for path in _c_files(folder, file) if folder.exists() else [folder]:
        check_output(path, [file])
    return folder


def _c_files(folder: Path, file: str) -> tuple[Path, Path]:
    """Return the paths of header and source."""
    from colony.compile.backends.c.generate import program_name

    name = program_name(Path(file).stem)
    return folder / f"{name}.h", folder / f"{name}.c"


def _write_c(
    compilation: Compilation, file: str, folder: Path, seconds: float | None, in_floats: bool
) -> None:
    """Write header and source in C, proved unless `seconds` is None, or `in_floats`."""
    from colony.compile.backends.c import single
    from colony.compile.backends.c.generate import generate_c
    from colony.text.diagnostics import DiagnosticError
    from colony.verify.equivalence.prove import prove

    program = compilation.program
    try:
        text = generate_c(compilation.compiled, Path(file).stem)
    except DiagnosticError as refused:
        refuse(refused.diagnostics)
    if in_floats:
        say("unproved: with --float it may decide otherwise than the network")
        text = single.in_floats(text)
    elif seconds is not None:
        with reliable_interrupts():
            result = prove(program, compilation, c=text, seconds=seconds)
        _report_proof(result, program, clients_file=None)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as problem:
        cannot_write(folder, reason(problem))
    for path, content in zip(_c_files(folder, file), (text.header, text.source), strict=True):
        write_whole(path, content)


def _proved(compilation: Compilation, file: str, no_proof: bool) -> Compiled:
    """Return the compiled program; with params of a site, with the contracts that are proved with them."""
    params = chosen_params()
    if params is None or no_proof:
        return compilation.compiled
    from colony.cli.site_proof import with_proof

    return with_proof(compilation, file, params, instead="--no-proof")


def _text(compilation: Compilation, format_: str, explain: bool) -> str:
    """Return the output in a format."""
    if format_ == "python":
        from colony.compile.backends.python.generate import generate

        return generate(compilation.compiled)
    if format_ == "json":
        from colony.compile.backends.json import to_json

        return to_json(compilation.clients, compilation.network.failsafe_modules)
    from colony.compile.backends.explain import explain as explanation
    from colony.compile.backends.table import client_table

    return explanation(compilation) if explain else client_table(compilation)


def _sequences(file: str) -> str:
    """Return what the sequences of a behavior stand for, as text before the rest of an explanation."""
    from colony.dsl.check.program import write_out

    written = write_out(check_to_run(file).tree, params=chosen_params())
    return f"The sequences, written out\n{indent(written, '  ')}\n" if written else ""


def _proof(compilation: Compilation, format_: str, text: str, seconds: float) -> Result:
    """Prove the clients, and their form in `text`; for a table, prove the compiled form that is executed."""
    from colony.verify.equivalence.prove import prove

    program = compilation.program
    if format_ == "python":
        return prove(program, compilation, python=text, seconds=seconds)
    if format_ == "json":
        return prove(program, compilation, json=text, seconds=seconds)
    from colony.execute.colonyc import decode, encode

    def sent() -> Compiled:
        return decode(encode(compilation.compiled), program.robot.name)

    return prove(program, compilation, sent=sent, seconds=seconds)


def _proof_of(existing: Path, program: Program, compilation: Compilation, seconds: float) -> Result:
    """Prove existing clients."""
    from colony.verify.equivalence import prove
    from colony.verify.equivalence.results import EquivalenceProved, WrongForm

    try:
        text = read_file(existing, CLIENTS_BYTES).decode("utf-8")
        header = ""
        if existing.suffix == ".c":
            header = read_file(existing.with_suffix(".h"), CLIENTS_BYTES).decode("utf-8")
    except OSError as problem:
        say(f"{problem.filename or existing}: error: cannot read: {reason(problem)}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except UnicodeDecodeError as problem:
        return WrongForm(
            form=str(existing), subject="text", found=str(problem), expected="clients as UTF-8 text"
        )
    if existing.suffix not in (".py", ".c"):
        return prove.prove_json(program, text, form=str(existing), seconds=seconds)
    clients = prove.prove(program, compilation, seconds=seconds)
    if not isinstance(clients, EquivalenceProved):
        return clients
    if existing.suffix == ".py":
        return prove.prove_python(program, compilation.clients, text, form=str(existing), seconds=seconds)
    from colony.compile.backends.c.generate import generate_c

    with naming_missing_extras():
        emitted = generate_c(compilation.compiled, existing.stem)
        found = replace(emitted, header=header, source=text)
        return prove.prove_c(program, compilation.clients, found, form=str(existing), seconds=seconds)


def _report_proof(result: Result, program: Program, clients_file: Path | None) -> None:
    """Report the result of the proof; exit with 1 if it failed."""
    from colony.text.diagnostics import error
    from colony.text.source import NOWHERE, Source, Span
    from colony.verify.equivalence import results

    span = NOWHERE if clients_file is None else Span(Source(str(clients_file), ""), 0, 0)
    spans = {wire.actuator: wire.span for wire in program.wires if wire.actuator is not None}
    match result:
        case results.EquivalenceProved():
            say(results.proved_text(result))
            return
        case results.EquivalenceUndecided(subjects=((_, subject), *_)) if installed("z3"):
            hint = "give z3 more time with --proof-timeout SECONDS"
            if clients_file is None:
                hint += ", or skip the proof with --no-proof"
            diagnostic = error("V002", spans.get(subject, span), results.undecided_text(result), hint)
        case results.EquivalenceUndecided():
            say(f"{results.undecided_text(result)}; run: {install_command('verify')}")
            return
        case results.WrongWinner() | results.WrongActivity() | results.WrongForm():
            subject = result.actuator if isinstance(result, results.WrongWinner) else ""
            hint = "these clients are not those of the behavior: compile it again"
            if clients_file is None:
                hint = "this is a bug in the compiler: please report it with the behavior"
            text = results.counterexample_text(result)
            diagnostic = error("V001", spans.get(subject, span), text, hint)
        case _:
            assert_never(result)
    report([diagnostic])
    raise click.exceptions.Exit(EXIT_ERRORS)
