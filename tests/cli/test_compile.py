from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest

from colony.dsl.check.program import without_sequences
from colony.dsl.load import check_file, check_text
from tests.cli.conftest import Colony
from tests.paths import MAPS, ROOT
from tests.verify.testing.seeded_bugs import BUGS


def test_explain_shows_the_steps(colony: Colony, behavior: Path) -> None:
    assert "cruise-back" in colony.output("compile", "--explain", behavior)


def test_explain_writes_sequences_out_as_a_part_of_a_program_that_checks(colony: Colony) -> None:
    path = ROOT / "behaviors" / "delivery.colony"
    shown = colony.output("compile", "--explain", "--no-proof", path)
    head, _, rest = shown.partition("\n")
    written = dedent(rest[: rest.index("\nThe network as wired")])
    assert head == "The sequences, written out"
    assert "machine deliver {" in written
    program = without_sequences(check_file(path).tree)
    assert written in program
    assert check_text(program, directory=path.parent).program is not None


def test_json_is_the_documented_form(colony: Colony, behavior: Path) -> None:
    document = json.loads(colony("compile", "--format", "json", behavior).out)
    assert document["format"] == "colony-clients/1"
    clients = document["actuators"]["drive"]["clients"]
    assert [(c["priority"], c["module"]) for c in clients] == [(2, "back"), (1, "cruise")]
    assert all(0 <= c["guard"] < len(document["nodes"]) for c in clients)


def test_generated_python_runs_alone(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    target = tmp_path / "b.py"
    assert colony("compile", "--format", "python", behavior, "-o", target).code == 0
    assert "import colony" not in target.read_text()
    compile(target.read_text(), str(target), "exec")


def test_errors_leave_no_output(colony: Colony, tmp_path: Path) -> None:
    path = tmp_path / "bad.colony"
    path.write_text("let a = 1 mm + 1 s")
    target = tmp_path / "out.json"
    assert colony("compile", path, "--format", "json", "-o", target).code == 1
    assert not target.exists()
    assert colony("compile", tmp_path / "none.colony").code == 2


def test_an_output_that_cannot_be_written(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    err = colony.refusal("compile", behavior, "-o", tmp_path / "no" / "such" / "x.txt")
    assert "cannot write: the folder does not exist" in err


# --- proofs --------------------------------------------------------------------------------------


@pytest.mark.parametrize("format_", ["table", "json", "python"])
def test_what_is_emitted_is_proved(colony: Colony, behavior: Path, format_: str) -> None:
    code, out, err = colony("compile", "--format", format_, behavior)
    form = {"table": "lowered code", "json": "JSON", "python": "generated Python"}[format_]
    assert code == 0
    assert re.fullmatch(rf"proved: clients, {form} and network are the same \(\d+ obligations: .*\)\n", err)
    assert colony("compile", "--format", format_, behavior, "--no-proof") == (0, out, "")


def test_without_proof_no_prover_is_loaded(behavior: Path) -> None:
    words = ["compile", "--no-proof", str(behavior)]
    program = f"import sys; sys.argv[1:] = {words}; from colony.cli.main import main\n"
    program += "try: main()\nfinally: print('z3' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "False"


@pytest.mark.parametrize("format_", ["table", "json", "python"])
def test_a_mistake_of_the_compiler_emits_nothing(
    colony: Colony, behavior: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, format_: str
) -> None:
    [bug] = [bug for bug in BUGS if bug.name == "priorities in reverse"]
    bug.plant(monkeypatch)
    target = tmp_path / "out"
    err = colony.refusal("compile", "--format", format_, behavior, "-o", target, code=1)
    assert not target.exists()
    assert "error[V001]: clients: drive: with " in err
    assert "  hint: this is a bug in the compiler" in err
    assert colony("compile", "--format", format_, behavior, "-o", target, "--no-proof").code == 0
    assert target.exists()


def test_a_mistake_in_the_emitted_python_emits_nothing(
    colony: Colony, behavior: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the text alone: what it was made from is right."""
    from colony.compile.backends.python import generate as python

    generate = python.generate
    calls = []

    def wrong(*arguments: Any) -> str:
        calls.append(arguments)
        text = generate(*arguments)
        return text.replace("drive_by = 'back'", "drive_by = 'cruise'") if len(calls) == 1 else text

    monkeypatch.setattr(python, "generate", wrong)
    err = colony.refusal("compile", "--format", "python", behavior, code=1)
    assert "error[V001]: generated Python: drive: " in err


@pytest.mark.parametrize(("format_", "name"), [("json", "b.json"), ("python", "b.py")])
def test_what_was_emitted_earlier_can_be_proved(
    colony: Colony, behavior: Path, tmp_path: Path, format_: str, name: str
) -> None:
    target = tmp_path / name
    assert colony("compile", "--format", format_, behavior, "-o", target).code == 0
    code, out, err = colony("compile", "--prove", target, behavior)
    assert (code, out) == (0, "")
    assert err.startswith(f"proved: {target} and network are the same (")
    text = target.read_text()
    changed = (
        text.replace('"guard": 0', '"guard": 1') if format_ == "json" else text.replace("'back'", "'cruise'")
    )
    target.write_text(changed)
    assert changed != text
    assert f"error[V001]: {target}: drive: " in colony.refusal("compile", "--prove", target, behavior, code=1)


def test_what_are_no_clients_is_told_with_the_file_as_its_place(
    colony: Colony, behavior: Path, tmp_path: Path
) -> None:
    clients = tmp_path / "empty.json"
    clients.write_bytes(b"")
    err = colony.refusal("compile", "--prove", clients, behavior, code=1)
    assert err.startswith(f"{clients}:1:1: error[V001]: ")


def test_a_proof_timeout_that_is_no_time_is_refused(colony: Colony, behavior: Path) -> None:
    err = colony.refusal("compile", "--proof-timeout", "nan", behavior)
    assert "'--proof-timeout'" in err
    assert "is not in the range 0<=x<=1000000.0" in err


def test_a_proof_goes_with_no_format(colony: Colony, behavior: Path) -> None:
    assert colony("compile", "--prove", behavior, "--format", "json", behavior).code == 2
    assert colony("compile", "--prove", "none.json", behavior).code == 2


# --- compiled programs -------------------------------------------------------------------------------


def test_a_compiled_program_runs_as_its_behavior_does_and_its_recording_is_audited(colony: Colony) -> None:
    wander = ROOT / "behaviors" / "wander.colony"
    assert colony("compile", wander, "-o", "wander.colonyc").code == 0
    options = ("--map", MAPS / "loop.stickrep", "--duration", "1", "--no-picture", "--record")
    ran = colony("run", "wander.colonyc", *options, "sent.mcap")
    assert ran.code == 0, ran.err
    assert colony("audit", "sent.mcap").code == 0
    assert colony("run", wander, *options, "here.mcap").out == ran.out.replace("sent.mcap", "here.mcap")
    assert Path("sent.mcap").read_bytes() == Path("here.mcap").read_bytes()


def test_a_compiled_program_is_known_by_its_content(colony: Colony) -> None:
    assert colony("compile", "wander", "-o", "w.colonyc", "--no-proof").code == 0
    compiled, options = Path("w.colonyc").read_bytes(), ("--map", "loop", "--duration", "0.1", "--no-picture")
    for name in ("W.COLONYC", "wander", "wander.colony"):
        Path(name).write_bytes(compiled)
        assert colony("run", name, *options).code == 0
        Path(name).write_bytes(compiled[:-1])
        code, _, err = colony("run", name, *options)
        assert (code, err.count("\n")) == (2, 1)
        assert "error[C001]: not a valid compiled program: it is damaged" in err


GOES = """
robot rome {
  sensor bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s, turn : deg/s } to RServer.drive idle drive(velocity = 0, turn = 0)
}
module go from python "goes:Go" { reads bumper commands drive }
network { drive = go }
"""

MODULE = """# -*- coding: latin-1 -*-
class Go:
    \"\"\"Va tout droit, très lentement.\"\"\"
    def step(self, frame):
        return {"velocity": 10.0, "turn": 0.0}
"""


def test_a_module_in_python_that_changed_since_is_not_run(colony: Colony) -> None:
    Path("goes.colony").write_text(GOES)
    Path("goes.py").write_bytes(MODULE.encode("latin-1"))
    assert colony("compile", "goes.colony", "-o", "goes.colonyc").code == 0
    run = ("run", "goes.colonyc", "--map", MAPS / "loop.stickrep", "--duration", "0.5", "--no-picture")
    assert colony(*run).code == 0
    Path("goes.py").write_bytes(MODULE.replace("10.0", "-10.0").encode("latin-1"))
    err = colony.refusal(*run)
    assert "error[C001]" in err
    assert "`goes.py` has changed since it was compiled" in err


@pytest.mark.parametrize("options", [["--explain"], ["--format", "json"]])
def test_a_compiled_program_has_one_format(colony: Colony, behavior: Path, options: list[str]) -> None:
    assert colony("compile", behavior, "-o", "b.colonyc", *options).code == 2
    assert not Path("b.colonyc").exists()


@pytest.mark.parametrize("command", ["check", "verify", "test", "graph", "compile"])
def test_commands_that_need_the_source_say_so(colony: Colony, behavior: Path, command: str) -> None:
    assert colony("compile", behavior, "-o", "b.colonyc", "--no-proof").code == 0
    (line,) = colony.refusal(command, "b.colonyc").splitlines()
    assert "b.colonyc" in line
    assert "error[E001]" in line
    assert "its source is needed" in line


# --- C -----------------------------------------------------------------------------------------------


def test_c_is_a_header_and_a_source_in_a_folder(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    folder = tmp_path / "firmware"
    done = colony("compile", "--format", "c", behavior, "-o", folder)
    assert done.code == 0
    assert done.err.startswith("proved: clients, generated C and network are the same")
    name = behavior.stem
    assert sorted(path.name for path in folder.iterdir()) == [f"{name}.c", f"{name}.h"]
    source = folder / f"{name}.c"
    assert f'#include "{name}.h"' in source.read_text()
    assert colony("compile", "--prove", source, behavior).code == 0
    source.write_text(source.read_text().replace("_by = B_BACK", "_by = B_CRUISE", 1))
    assert colony("compile", "--prove", source, behavior).code == 1
    (folder / f"{name}.h").unlink()
    assert colony("compile", "--prove", source, behavior).code == 2


def test_c_with_floats_is_written_without_a_proof(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    done = colony("compile", "--format", "c", "--float", behavior, "-o", tmp_path / "firmware")
    assert (done.code, done.err[:9]) == (0, "unproved:")
    assert (tmp_path / "firmware" / f"{behavior.stem}.h").read_text().startswith("/* UNPROVED: ")
    assert "--float requires --format c" in colony("compile", "--float", behavior).err


def test_c_without_a_folder_is_refused(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    assert "requires -o FOLDER" in colony("compile", "--format", "c", behavior).err
    file = tmp_path / "file"
    file.touch()
    assert colony("compile", "--format", "c", behavior, "-o", file).code == 2
    assert colony("compile", "--format", "c", behavior, "-o", tmp_path / "no" / "folder").code == 2


def test_c_that_does_not_say_what_the_network_says_is_not_written(
    colony: Colony, behavior: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from colony.compile.backends.c import generate

    right = generate.generate_c

    def wrong(compiled: Any, name: str = "") -> Any:
        text = right(compiled, name)
        [(first, second)] = re.findall(r'_modules\[\] = \{"", ("\w+"), ("\w+")', text.source)
        return replace(text, source=text.source.replace(f"{first}, {second}", f"{second}, {first}"))

    monkeypatch.setattr(generate, "generate_c", wrong)
    done = colony("compile", "--format", "c", behavior, "-o", tmp_path / "firmware")
    assert done.code == 1
    assert "V001" in done.err
    assert not (tmp_path / "firmware").exists()
