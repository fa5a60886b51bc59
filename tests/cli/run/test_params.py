"""`colony run --params` and what follows from it: proofs before the run, compiled programs, recordings."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from colony.cli import site_proof
from tests.cli.conftest import Colony
from tests.cli.machine import Machine, failed
from tests.waiting import until

BEHAVIOR = """language 1
import "rome"
param cruising = 300 mm/s
param other = 1
module go { param boost = 1  when not bumper  do drive(velocity = cruising * boost, turn = 0) }
network { drive = go }
contract slowly: drive.velocity <= 350 mm/s
contract open: drive.velocity < 100 mm/s
"""

SAFE = 'other = 2\ncruising = "200 mm/s"\n'
FAST = 'other = 2\ncruising = "200 mm/s"\ngo.boost = 2\n'

RUN = ("--map", "loop", "--duration", "0.5", "--no-picture")


@pytest.fixture
def site(colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a behavior with a safe and a fast site, and a cache of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    Path("b.colony").write_text(BEHAVIOR)
    Path("safe.toml").write_text(SAFE)
    Path("fast.toml").write_text(FAST)
    return tmp_path


def test_a_contract_that_was_proved_is_proved_before_the_run_and_once(colony: Colony, site: Path) -> None:
    first = colony("run", "b.colony", *RUN, "--params", "safe.toml", "--format", "json")
    assert "proving contracts with the params of safe.toml" in first.err
    again = colony("run", "b.colony", *RUN, "--params", "safe.toml", "--format", "json")
    assert "proving" not in again.err
    assert first.code == again.code == 1  # `open` is broken with the program's own values, too
    found = json.loads(again.out)["params"]
    assert (found["file"], found["proved"], len(found["hash"])) == ("safe.toml", True, 64)


def test_a_broken_proof_is_shown_with_the_value_and_the_run(colony: Colony, site: Path) -> None:
    for _ in range(2):  # the second time the verdicts are known, but the run is shown
        err = colony.refusal("run", "b.colony", *RUN, "--params", "fast.toml", "--record", "r.mcap", code=1)
        assert (
            "fast.toml:3:12: error[V013]: with `go.boost = 2`, contract `slowly` is not proved any more"
            in err
        )
        assert "b.colony:7:10: note: the contract, which is proved with the program's own values" in err
        assert "b.colony: REFUTED  slowly" in err
        assert "by go: velocity = 400 mm/s" in err
        assert "`open`" not in err
        assert not Path("r.mcap").exists()


def test_the_values_that_matter_together_are_all_shown(colony: Colony, site: Path) -> None:
    Path("two.toml").write_text('other = 3\ncruising = "200 mm/s"\ngo.boost = 1.8\n')
    Path("b.colony").write_text(BEHAVIOR.replace("cruising = 300", "cruising = 100"))
    ran = colony("run", "b.colony", *RUN, "--params", "two.toml")
    assert "with `cruising = 200 mm/s` and `go.boost = 1.8`, contract `slowly`" in ran.err
    assert "two.toml:3:12: note: and this value" in ran.err


@pytest.mark.parametrize("record", ["r.mcap", "r.jsonl"])
def test_a_recording_has_the_values(colony: Colony, site: Path, record: str) -> None:
    ran = colony("run", "b.colony", *RUN, "--params", "fast.toml", "--unproved", "--record", record)
    assert "proving" not in ran.err
    assert "with the params of fast.toml (" in ran.out
    assert "UNPROVED" in ran.out
    Path("fast.toml").unlink()
    file = [] if record == "r.mcap" else ["b.colony"]
    found = json.loads(colony.output("audit", record, *file, "--format", "json"))
    assert found["params"] == {"cruising": "200 mm/s", "go.boost": "2", "other": "2"}
    traced = colony("trace", "b.colony", "--input", record)
    assert '"velocity": 400.0' in traced.out
    others = colony("trace", "b.colony", "--input", record, "--params", "safe.toml")
    assert '"velocity": 200.0' in others.out
    assert "(the run was not proved with them)" in colony("audit", "r.mcap").out or record == "r.jsonl"


def test_errors_in_values_for_a_recorded_program_are_reported_in_their_file(
    colony: Colony, site: Path
) -> None:
    colony("run", "b.colony", *RUN, "--record", "r.mcap")
    Path("bad.toml").write_text("cruising = 200\ngo.speed = 2\n")
    checked = colony("check", "b.colony", "--params", "bad.toml")
    for command in (("audit", "r.mcap"), ("trace", "--input", "r.mcap")):
        err = colony.refusal(*command, "--params", "bad.toml", code=1)
        assert err == checked.err
        assert ["E704" in err, "E703" in err] == [True, True]


def test_a_recording_with_other_values_than_its_hash_is_refused(colony: Colony, site: Path) -> None:
    colony("run", "b.colony", *RUN, "--params", "safe.toml", "--unproved", "--record", "r.mcap")
    Path("r.mcap").write_bytes(Path("r.mcap").read_bytes().replace(b"200 mm/s", b"201 mm/s"))
    assert colony("audit", "r.mcap").code != 0


def test_without_params_nothing_is_proved_or_recorded(colony: Colony, site: Path) -> None:
    ran = colony("run", "b.colony", *RUN, "--record", "r.jsonl")
    assert "params" not in ran.out + ran.err + Path("r.jsonl").read_text()
    assert not Path("cache").exists()


def test_a_damaged_or_unwritable_cache_stops_nothing(
    colony: Colony, site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = site / "cache" / "colony" / "proofs"
    for damage in ("nothing kept", "{", "[1]", "a folder in the way"):
        for path in folder.iterdir() if folder.exists() else ():
            path.unlink()
            if damage.startswith("a folder"):
                path.mkdir()
            else:
                path.write_text(damage)
        ran = colony("run", "b.colony", *RUN, "--params", "safe.toml")
        assert "proving contracts" in ran.err, damage
        assert "with the params of safe.toml" in ran.out, damage
    Path("in_the_way").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(site / "in_the_way"))
    ran = colony("run", "b.colony", *RUN, "--params", "safe.toml")
    assert "proving contracts" in ran.err
    assert "with the params of safe.toml" in ran.out


def test_a_compiled_program_has_its_values_and_its_proof(colony: Colony, site: Path) -> None:
    assert colony("compile", "b.colony", "--params", "safe.toml", "-o", "x.colonyc").code == 0
    sys.path[:] = [p for p in sys.path if p]
    for options in ((), ("--params", "safe.toml")):
        ran = colony("run", "x.colonyc", *RUN, *options, "--format", "json")
        assert "proving" not in ran.err
        assert json.loads(ran.out)["params"]["proved"] is True
    err = colony.refusal("run", "x.colonyc", *RUN, "--params", "fast.toml")
    assert "it was not compiled with the params of fast.toml" in err
    assert colony("compile", "b.colony", "--params", "fast.toml", "-o", "y.colonyc").code == 1
    assert not Path("y.colonyc").exists()
    assert colony("compile", "b.colony", "--params", "fast.toml", "--no-proof", "-o", "y.colonyc").code == 0
    assert "or give --unproved" in colony.refusal("run", "y.colonyc", *RUN)
    assert "UNPROVED" in colony("run", "y.colonyc", *RUN, "--unproved").out


def test_without_z3_a_run_is_refused_but_for_a_compiled_program(
    colony: Colony, site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    colony("compile", "b.colony", "--params", "safe.toml", "-o", "x.colonyc")
    monkeypatch.setattr(site_proof, "installed", lambda module: False)
    err = colony.refusal("run", "b.colony", *RUN, "--params", "safe.toml")
    assert "8 contracts must be proved with these params, and z3 is not installed" in err
    assert "give --unproved" in err
    assert "with the params of safe.toml" in colony("run", "x.colonyc", *RUN).out


def test_a_program_with_errors_of_its_own_must_prove_everything(colony: Colony, site: Path) -> None:
    Path("b.colony").write_text(BEHAVIOR.replace("other = 1", "other = 1 / 0"))
    err = colony.refusal("run", "b.colony", *RUN, "--params", "safe.toml", code=1)
    assert "E212" in err  # the value in the text is checked as well


def test_misuse_is_reported(colony: Colony, site: Path) -> None:
    missing = colony("run", "b.colony", *RUN, "--params", "nothing.toml")
    assert (missing.code, missing.err.count("\n")) == (2, 1)
    assert "nothing.toml:1:1: error[E701]" in missing.err
    assert "--unproved requires --params" in colony.refusal("run", "b.colony", *RUN, "--unproved")


def test_other_commands_take_params(colony: Colony, site: Path) -> None:
    Path("b.colony").write_text(
        BEHAVIOR + 'test "t" { at 0 s given bumper = false expect drive.velocity == 400 mm/s }'
    )
    option = ("--params", "fast.toml")
    assert "b.colony: ok" in colony("check", "b.colony", *option).out
    assert "expectation" not in colony("test", "b.colony", *option).err
    assert "REFUTED  slowly" in colony("verify", "b.colony", *option, "--contract", "slowly").out
    assert colony("graph", "b.colony", *option).code == 0
    assert "400" in colony("compile", "b.colony", *option, "--format", "python").out
    assert colony("diff", "b.colony", "b.colony", *option).code == 0
    frame = '{"t": 0, "bumper": false}'
    assert '"by": "go"' in colony("trace", "b.colony", *option, "--input", "-", stdin=frame).out


def test_ctrl_c_ends_the_proof(machine: Machine, tmp_path: Path) -> None:
    params = tmp_path / "site.toml"
    params.write_text('[hallway]\ncruising = "450 mm/s"\n')
    machine.environment["XDG_CACHE_HOME"] = str(tmp_path / "cache")
    way = ("--map", "loop", "--from", "201", "--to", "216", "--no-picture")
    run = machine.start("run", "navigator", *way, "--params", str(params), "--record", "r.mcap")
    until(lambda: failed(run) or "proving contracts with the params of " in run.err, "it proves")
    assert run.interrupt() == 130
    assert not (run.folder / "r.mcap").exists()
