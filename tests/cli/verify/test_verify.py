"""`colony verify`: verdicts, traces, tests that it writes, formats, exit codes."""

from __future__ import annotations

import itertools
import json
import os
import time
from pathlib import Path

import pytest
import z3

from colony.cli.verify.work import Work, load
from colony.verify.contracts import certificate
from tests.cli.conftest import Colony
from tests.cli.machine import Machine, failed
from tests.sampling import long
from tests.verify.small_robot import go, robot
from tests.waiting import until

TRUE = "contract backs: drive by back implies drive.velocity <= 0\n"
FALSE = "contract quick: drive.velocity > -100 mm/s\n"
LONG = "contract lasts: drive by back implies bumper\n"
OPEN = "state n = 0  next n = if bumper then n + 0.5 else n - 0.5\ncontract never_quarter: n != 0.25\n"
QUICK = ("--depth", "1", "--timeout", "0.3")


def add(behavior: Path, *texts: str) -> Path:
    """Append to a behavior file."""
    behavior.write_text(behavior.read_text() + "".join(texts))
    return behavior


# --- verdicts --------------------------------------------------------------------------------------


def test_refuted_shows_the_run_and_the_place(colony: Colony, behavior: Path) -> None:
    code, out, err = colony("verify", add(behavior, TRUE, LONG))
    assert code == 1
    assert f"{behavior}: REFUTED  lasts\n" in out
    table = [line.split("  ") for line in out.splitlines() if "by back: " in line]
    assert [[cell.strip() for cell in row if cell][:3] for row in table] == [
        ["0 s", "all 0", "true"],
        ["0.05 s", "all 0", "false"],
    ]
    assert "error[V010]: contract `lasts` is false at 0.05 s of a run of 2 frames" in err
    assert f"hint: `colony verify --write-test {behavior}`" in err
    assert "1 proved, 1 refuted, 0 unknown" in out.splitlines()[-1]


def test_unknown_says_why_and_is_no_error(colony: Colony, behavior: Path) -> None:
    code, out, err = colony("verify", *QUICK, add(behavior, OPEN))
    assert code == 0
    assert f"{behavior}: unknown  never_quarter\n" in out
    assert "no run of up to 6 frames breaks it" in out
    assert "warning[V011]: contract `never_quarter` is neither proved nor refuted" in err
    assert colony("verify", "--strict", *QUICK, behavior).code == 1


def test_nothing_is_said_twice(colony: Colony, behavior: Path) -> None:
    far = "contract far{}: near >= 1 m\n"
    _, out, err = colony("verify", add(behavior, far.format(1), far.format(2)))
    assert out.count("in the last frame: ") == 2
    assert "found:" not in err
    assert err.count("hint: a contract must be true") == 1


def test_a_test_is_written_as_soon_as_its_run_is_found(behavior: Path) -> None:
    verified = load(str(add(behavior, FALSE, LONG)), write_test=True)
    work = Work(
        names=(),
        why=(),
        depth=1,
        timeout=None,
        certificates=None,
        examples=0,
        seed=0,
        faults=False,
        margin=False,
    )
    next(work.run(verified, lambda completed, total, current: None))
    assert 'test "quick' in behavior.read_text() or "quick" in behavior.read_text().split(FALSE)[1]


def test_values_in_percent_are_shown_in_percent(colony: Colony, tmp_path: Path) -> None:
    file = tmp_path / "gas.colony"
    file.write_text("""robot r {
  sensor gas : percent range 0 .. 100 from DServer.Gas
  actuator fan { level : percent range 0 .. 100 } to DServer.Fan idle fan(level = 0)
}
state peak : percent = 0  next peak = max(peak, gas)
module m { let half = gas / 2 + 10 percent  when gas > 50 percent do fan(level = half) }
network { fan = m }
contract low: fan by m implies m.half + peak < 70 percent
test "t" { at 0 s given gas = 80 expect m.half == 20 percent }
""")
    _, out, _ = colony("verify", file)
    assert "`m.half + peak < 70 percent` fails by" in out
    assert "percent against 70 percent" in out
    assert "m.half = 60 percent" in out
    assert "peak = 100 percent" in out
    _, out, err = colony("test", "--explain", file)
    assert "50 percent against 20 percent" in out
    assert "found: m.half = 50 percent" in err


def test_only_the_contracts_named(colony: Colony, behavior: Path) -> None:
    assert "quick" not in colony.output("verify", "--contract", "backs", add(behavior, TRUE, FALSE))


@pytest.mark.parametrize("command", ["verify", "diff", "compile"])
def test_a_clock_that_jumps_changes_no_result(
    colony: Colony, behavior: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    files = [add(behavior, TRUE, FALSE, OPEN)]
    if command == "diff":
        files.append(behavior.with_name("other.colony"))
        files[1].write_text(behavior.read_text().replace("near / 1 s", "2 * near / 2 s"))
    options = QUICK if command == "verify" else ()
    expected = colony(command, *options, *files)
    days, set_option = itertools.count(0, 86_400), z3.Solver.set

    def set_resources(solver: z3.Solver, *options: object) -> None:
        assert options[0] == "rlimit"
        set_option(solver, *options)

    for clock in ("time", "monotonic", "perf_counter", "process_time"):
        monkeypatch.setattr(time, clock, lambda: float(next(days)))
    monkeypatch.setattr(z3.Solver, "set", set_resources)
    assert colony(command, *options, *files) == expected


def test_certificates_are_written_of_what_is_proved(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    folder = tmp_path / "proofs" / "new"
    folder.mkdir(parents=True)
    (folder / "quick.smt2").write_text("of an earlier version, in which it held")
    code, _, err = colony("verify", "--certificate", folder, add(behavior, TRUE, FALSE))
    assert (code, "no certificate" in err) == (1, False)
    assert [path.name for path in folder.iterdir()] == ["backs.smt2"]
    assert ";   contract backs: drive by back implies" in (folder / "backs.smt2").read_text()


def test_a_certificate_that_is_not_found_is_reported(
    colony: Colony, behavior: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(certificate, "certificate", lambda *_: None)
    code, out, err = colony("verify", "--certificate", "proofs", add(behavior, TRUE))
    assert code == 0
    assert "proved   backs" in out
    assert f"{Path('proofs/backs.smt2')}: no certificate: z3 gave up; raise --timeout\n" in err
    assert list(Path("proofs").iterdir()) == []


@pytest.mark.parametrize(
    ("options", "said"),
    [
        *((("--timeout", seconds), "is not in the range 0<x<=1000000.0") for seconds in ("nan", "inf", "0")),
        (("--contract", "bakcs"), "no contract `bakcs`; did you mean `backs`?"),
        (("--faults",), "--faults requires --examples"),
        (("--certificate", "proofs", "other.colony"), "--certificate requires a single FILE"),
        (("--certificate", "b.colony/p"), "b.colony/p: error: cannot write: Not a directory"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    colony: Colony, behavior: Path, options: tuple[str, ...], said: str
) -> None:
    assert said in colony.refusal("verify", add(behavior, TRUE), *options)


def test_a_behavior_without_contracts_is_said_to_have_none(colony: Colony, behavior: Path) -> None:
    assert f"{behavior}: no contracts found" in colony.output("verify", behavior)


LATE = "contract acts: back is active implies drive by back or not drive is idle\n"


def test_proved_only_while_every_client_is_in_time_is_summed_up_and_a_note(
    colony: Colony, behavior: Path
) -> None:
    summary = colony.output("verify", "--contract", "acts", add(behavior, LATE)).splitlines()[-1]
    assert "1 proved (1 of them only while every client is in time), 0 refuted, 0 unknown" in summary
    [found] = json.loads(colony.output("verify", "--contract", "acts", "--format", "sarif", behavior))[
        "runs"
    ][0]["results"]
    assert (found["ruleId"], found["level"]) == ("V012", "note")
    assert found["codeFlows"]


def test_a_contract_in_time_is_proved_without_a_note(colony: Colony, behavior: Path) -> None:
    file = add(behavior, LATE.replace("acts:", "acts in time:"))
    code, out, err = colony("verify", "--strict", "--why", "acts", file)
    assert (code, err) == (0, "")
    assert out == f"{behavior}: proved in time  acts\n1 proved, 0 refuted, 0 unknown\n"
    _, out, _ = colony("verify", "--contract", "acts", "--format", "json", behavior)
    [entry] = json.loads(out)["files"]
    assert entry["diagnostics"] == []
    [contract] = entry["contracts"]
    assert (contract["verdict"], contract["in_time"]) == ("proved_in_time", True)
    assert "trace" not in contract


@pytest.mark.parametrize(
    ("contract", "shown"),
    [
        ("drive.velocity == 0 or drive by back or drive by cruise", "by an operator: velocity = "),
        ("not drive by cruise or near >= 0 mm", None),
    ],
)
def test_why_shows_the_run_in_which_an_operator_breaks_a_contract(
    colony: Colony, behavior: Path, contract: str, shown: str | None
) -> None:
    add(behavior, f"contract c: {contract}\n", TRUE)
    _, out, _ = colony("verify", behavior)
    assert ("c  (without operators: --why c)\n" in out) == (shown is not None)
    out = colony.output("verify", "--why", "c", behavior)
    assert "backs" not in out
    assert (f"{behavior}: proved   c  (operators too)\n" in out) == (shown is None)
    assert ("a command from outside the network breaks it, within the limits:" in out) == (shown is not None)
    assert shown is None or shown in out
    _, out, _ = colony("verify", "--why", "c", "--format", "json", behavior)
    [row] = json.loads(out)["files"][0]["contracts"]
    runs = row.get("operator_runs")
    assert runs is None if shown is None else [list(frame["commanded"]) for frame in runs[0]] == [["drive"]]


REACHES = "reach gone: drive by back\nreach both: drive by back and drive by cruise\n"


def test_reaches_are_reached_or_never(colony: Colony, behavior: Path) -> None:
    file = add(behavior, REACHES)
    code, out, err = colony("verify", "--contract", "both", "--contract", "gone", file)
    assert code == 1
    assert f"{file}: reached  gone  (in 1 frame)\n    time " in out
    assert f"{file}: NEVER REACHED  both\n0 proved, 0 refuted, 0 unknown, 1 reached, 1 never reached" in out
    assert "error[V015]: no run reaches `both`" in err
    assert "V010" not in err
    code, out, _ = colony("verify", "--strict", "--contract", "gone", "--write-test", file)
    assert (code, file.read_text().count('test "reach: gone"')) == (0, 1)
    assert colony("test", file)[0] == 0
    assert "did you mean `gone`?" in colony.refusal("verify", "--contract", "gonne", file)


def test_reaches_are_in_json_and_sarif(colony: Colony, behavior: Path) -> None:
    file = add(behavior, TRUE, REACHES)
    code, out, _ = colony("verify", "--format", "json", file)
    assert code == 1
    [entry] = json.loads(out)["files"]
    assert [(r["contract"], r["verdict"]) for r in entry["contracts"]] == [("backs", "proved")]
    assert [(r["reach"], r["verdict"]) for r in entry["reaches"]] == [
        ("gone", "reached"),
        ("both", "never_reached"),
    ]
    _, out, _ = colony("verify", "--format", "sarif", file)
    assert "V015" in {found["ruleId"] for found in json.loads(out)["runs"][0]["results"]}


def test_several_files(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.colony"
    other.write_text(behavior.read_text() + FALSE)
    code, out, _ = colony("verify", add(behavior, TRUE), other)
    assert code == 1
    assert f"{behavior}: proved   backs" in out
    assert f"{other}: REFUTED  quick" in out


def test_what_cannot_be_read_is_misuse_and_the_rest_is_done(colony: Colony, behavior: Path) -> None:
    code, out, err = colony("verify", "absent.colony", add(behavior, TRUE))
    assert code == 2
    assert "absent.colony" in err
    assert "proved   backs" in out


def test_errors_in_a_file_are_told(colony: Colony, behavior: Path) -> None:
    assert "error[E" in colony.refusal("verify", add(behavior, "contract c: nothing"), code=1)


def test_a_module_in_python_may_answer_anything(colony: Colony, tmp_path: Path) -> None:
    path = tmp_path / "p.colony"
    path.write_text(
        """robot r {
  sensor near : mm range 0 .. 5000 from PServer.near
  actuator drive { velocity : mm/s range -600 .. 600 } to RServer.drive idle drive(velocity = 0)
}
module guess from python "nowhere:Guess" { reads near commands drive }
network { drive = guess }
contract within: drive.velocity <= 600 mm/s
contract slow: drive.velocity <= 100 mm/s
"""
    )
    code, out, err = colony("verify", path)
    assert code == 0
    assert "proved   within" in out
    assert "unknown  slow" in out
    assert "guess answers" in out
    assert "warning[V011]" in err
    colony.output("verify", "--write-test", path)
    assert "test" not in path.read_text()


# --- tests that are written ------------------------------------------------------------------------


def test_a_written_test_fails_in_colony_test_until_the_contract_holds(colony: Colony, behavior: Path) -> None:
    add(behavior, LONG)
    before = behavior.read_text()
    code, _, err = colony("verify", "--write-test", behavior)
    assert code == 1
    assert 'wrote the test "counterexample: lasts"' in err
    assert "--write-test" not in err
    after = behavior.read_text()
    assert after.startswith(before)
    assert after[len(before) :] == (
        '\ntest "counterexample: lasts" {\n'
        "  at 0 s given rays = 0, bumper = true\n"
        "  at 0.05 s given bumper = false\n"
        "}\n"
    )
    code, _, err = colony("test", behavior)
    assert code == 1
    assert 'error[T003]: in "counterexample: lasts" at 0.05 s: contract `lasts:' in err
    behavior.write_text(after.replace(LONG, ""))
    code, out, _ = colony("test", behavior)
    assert (code, out.splitlines()[-1]) == (0, "2 passed, 0 failed")


def test_a_test_is_written_once(colony: Colony, behavior: Path) -> None:
    add(behavior, FALSE)
    colony("verify", "--write-test", behavior)
    once = behavior.read_bytes()
    _, _, err = colony("verify", "--write-test", behavior)
    assert behavior.read_bytes() == once
    assert "already exists" in err


def test_a_second_counterexample_gets_a_name_of_its_own(colony: Colony, behavior: Path) -> None:
    add(behavior, FALSE, 'test "counterexample: quick" { at 0 s }\n')
    _, _, err = colony("verify", "--write-test", behavior)
    assert 'wrote the test "counterexample: quick (2)"' in err
    assert colony("check", behavior).code == 0


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_file_is_refused_before_the_work(colony: Colony, behavior: Path) -> None:
    add(behavior, FALSE).chmod(0o444)
    before = behavior.read_bytes()
    err = colony.refusal("verify", "--write-test", behavior)
    assert f"{behavior}: error: cannot write: Permission denied" in err
    assert behavior.read_bytes() == before


def test_line_breaks_stay_as_they_are(colony: Colony, behavior: Path) -> None:
    behavior.write_bytes(add(behavior, FALSE).read_bytes().rstrip().replace(b"\n", b"\r\n"))
    colony("verify", "--write-test", behavior)
    data = behavior.read_bytes()
    assert data.count(b"\n") == data.count(b"\r\n")
    assert b"counterexample: quick" in data
    assert colony("check", behavior).code == 0


def test_a_file_that_cannot_be_written_stays_as_it_was(colony: Colony, behavior: Path) -> None:
    add(behavior, FALSE)
    before = behavior.read_bytes()
    if os.geteuid() == 0:
        pytest.skip("root writes everywhere")
    behavior.parent.chmod(0o500)
    try:
        code, _, err = colony("verify", "--write-test", behavior)
    finally:
        behavior.parent.chmod(0o700)
    assert code == 2
    assert "cannot write" in err
    assert behavior.read_bytes() == before


# --- drawn traces ----------------------------------------------------------------------------------


def test_drawn_traces_break_what_could_not_be_decided(colony: Colony, behavior: Path) -> None:
    add(behavior, "contract c: fresh(rays) implies sin(rays[0] * 1 deg) * sin(rays[0] * 1 deg) < 0.9\n")
    code, _, err = colony("verify", "--examples", "60", behavior)
    assert code == 1
    assert "error[V010]: contract `c` is false" in err


# --- formats ---------------------------------------------------------------------------------------


def test_json_has_every_verdict(colony: Colony, behavior: Path) -> None:
    code, out, _ = colony("verify", "--format", "json", *QUICK, add(behavior, TRUE, LONG, OPEN))
    assert code == 1
    told = json.loads(out)
    [file] = told["files"]
    assert told["interrupted"] is False
    assert file["file"] == str(behavior)
    verdicts = {c["contract"]: c["verdict"] for c in file["contracts"]}
    assert verdicts == {"backs": "proved", "lasts": "refuted", "never_quarter": "unknown"}
    trace = file["contracts"][1]["trace"]
    assert [step["frame"].get("bumper") for step in trace] == [True, False]
    assert [step["broken"] for step in trace] == [[], ["lasts"]]
    assert {d["code"] for d in file["diagnostics"]} >= {"V010", "V011"}
    lines = "".join(json.dumps(step["frame"]) + "\n" for step in trace)
    out = colony.output("trace", behavior, "--input", "-", stdin=lines)
    decided = [json.loads(line) for line in out.splitlines()]
    assert [line["drive"] for line in decided] == [step["sent"]["drive"] for step in trace]
    assert [line.get("breaches", []) for line in decided] == [step["broken"] for step in trace]


def test_sarif_has_the_run_as_a_code_flow(colony: Colony, behavior: Path) -> None:
    code, out, _ = colony("verify", "--format", "sarif", add(behavior, LONG))
    assert code == 1
    results = json.loads(out)["runs"][0]["results"]
    [refuted] = [r for r in results if r["ruleId"] == "V010"]
    [flow] = refuted["codeFlows"]
    assert len(flow["threadFlows"][0]["locations"]) == 2


CONTRADICTING = "limit drive.velocity <= 100 mm/s limit drive.velocity >= 200 mm/s when recently(bumper, 1 s)"


def test_a_run_that_shows_a_lint_is_shown_like_that_of_a_contract(colony: Colony, behavior: Path) -> None:
    code, out, err = colony("verify", add(behavior, CONTRADICTING))
    assert (code, err.count("warning[V033]")) == (0, 1)
    assert f"{behavior}: V033     drive.velocity\n    time" in out
    assert "(limits contradict): velocity = 0 mm/s" in out
    code, out, _ = colony("verify", "--format", "json", behavior)
    [found] = [d for d in json.loads(out)["files"][0]["diagnostics"] if d["code"] == "V033"]
    lines = "".join(json.dumps(step["frame"]) + "\n" for step in found["trace"])
    _, out, _ = colony("trace", behavior, "--input", "-", stdin=lines)
    decided = [json.loads(line)["drive"] for line in out.splitlines()]
    assert decided[-1].pop("fault") == "limits contradict"
    assert decided == [step["sent"]["drive"] for step in found["trace"]]
    _, out, _ = colony("verify", "--format", "sarif", behavior)
    [result] = [r for r in json.loads(out)["runs"][0]["results"] if r["ruleId"] == "V033"]
    assert len(result["codeFlows"][0]["threadFlows"][0]["locations"]) == len(lines.splitlines())


LIFT = """robot r {
  sensor   level : number default 0 from DServer.Level
  actuator lift { height : mm } to DServer.Lift idle hold
}
module reach { when level > 0 do lift(height = 1 m) }
network { lift = reach }
limit lift.height <= 1 m
limit lift.height >= 2 m when level > 50
"""


def test_limits_that_contradict_on_hold_fail(colony: Colony, behavior: Path) -> None:
    behavior.write_text(LIFT)
    code, out, err = colony("verify", behavior)
    assert (code, err.count("error[V033]")) == (1, 1)
    assert "by reach (limits contradict): nothing is sent" in out


# --- margins ---------------------------------------------------------------------------------------

WIDE = (
    robot()
    + go("cruise", "true")
    + go("slow", "sonar < 1200 mm", "100 mm/s").replace("module", "failsafe module")
    + "network { drive = slow suppresses cruise }\n"
    + "contract near: value_or(sonar < 1 m, false) implies drive.velocity <= 100 mm/s\n"
    + "contract hit: value_or(bumper, false) implies drive.velocity <= 300 mm/s\n"
)


def test_margins_are_a_table_with_a_run_at_each_end(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "wide.colony").write_text(WIDE)
    out = colony.output("verify", "--margin", "--contract", "near", "wide.colony")
    assert "  near      sonar   ± 190 mm            ± 200 mm\n" in out
    assert "near with `sonar` late by 1 reading:\n    time" in out
    assert "near with" not in colony.output("verify", "--margin", "wide.colony")
    found = json.loads(colony.output("verify", "--margin", "--format", "json", "wide.colony"))
    margins = found["files"][0]["margins"]
    assert [(m["contract"], m["kind"], m["unit"]) for m in margins] == [
        ("near", "wrong", "mm"),
        ("near", "late", "readings"),
        ("near", "rare", "readings"),
    ]
    assert all(m["complete"] and m["proved"] < m["refuted"] for m in margins)
    assert margins[0]["trace"][-1]["frame"]["sonar error"] > 0
    assert margins[0]["trace"][-1]["broken"] == ["near"]


# --- interruption ----------------------------------------------------------------------------------

ENDLESS = ["--depth", "64", "--timeout", "1000"]
"""With these, `OPEN` takes a minute."""


def busy_seconds(pid: int) -> float:
    """The processor time that a process has had."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="there is no /proc")
@pytest.mark.parametrize("format_", [long("text"), "json"])
def test_ctrl_c_tells_what_was_found_so_far(machine: Machine, behavior: Path, format_: str) -> None:
    add(behavior, TRUE, OPEN)
    started = machine.start("verify", *ENDLESS, "--format", format_, str(behavior))
    until(lambda: failed(started) or busy_seconds(started.pid) >= 2, "it is at work")
    assert started.interrupt() == 130
    assert "interrupted" in started.err
    if format_ == "json":
        told = json.loads(started.out)
        assert told["interrupted"] is True
        assert [c["contract"] for c in told["files"][0]["contracts"]] == ["backs"]
    else:
        assert "proved   backs" in started.out
        assert "interrupted before the end" in started.out


def test_what_can_never_act_is_asked_for_a_while_only(colony: Colony, tmp_path: Path) -> None:
    modules = "\n".join(f"module m{i} {{ when s > {i} mm do drive(velocity = {i} mm/s) }}" for i in range(60))
    file = tmp_path / "many.colony"
    file.write_text(
        f"""robot r {{
  sensor s : mm range 0 .. 10000 from P.s
  actuator drive {{ velocity : mm/s range 0 .. 500 }} to R.drive idle drive(velocity = 0)
}}
{modules}
network {{ drive = {" suppresses ".join(f"m{i}" for i in range(60))} }}
"""
    )
    out = colony.output("verify", "--timeout", "0.05", str(file))
    assert "about modules that can never act; raise --timeout" in out


# --- assumptions -----------------------------------------------------------------------------------

ASSUMED = """assume apart: near > 200 mm
contract off: value_or(near > 100 mm, true)
contract further: value_or(near > 300 mm, true)
"""


def test_verdicts_name_the_assumptions_that_they_rest_on(
    colony: Colony, behavior: Path, tmp_path: Path
) -> None:
    add(behavior, ASSUMED)
    code, out, err = colony("verify", behavior)
    assert code == 1
    assert f"{behavior}: proved   off  (assuming apart)  (operators too)\n" in out
    assert f"{behavior}: REFUTED  further\n" in out
    assert "apart" not in err
    assert colony("verify", "--contract", "off", "--strict", behavior).code == 0
    assert "no contract `apart`" in colony("verify", "--contract", "apart", behavior).err
    rows = json.loads(colony("verify", "--format", "json", behavior).out)["files"][0]["contracts"]
    assert [(r["contract"], r["verdict"], r["assuming"]) for r in rows] == [
        ("off", "proved", ["apart"]),
        ("further", "refuted", ["apart"]),
    ]
    colony("verify", "--contract", "off", "--certificate", tmp_path / "proofs", behavior)
    text = (tmp_path / "proofs" / "off.smt2").read_text()
    assert ";   assuming apart: near > 200 mm\n" in text
    assert "assumptions held" in text


def test_drawn_traces_count_up_to_a_broken_assumption(colony: Colony, behavior: Path) -> None:
    add(behavior, "assume apart: near > 200 mm\ncontract off: value_or(near > 100 mm, true)\n")
    code, out, _ = colony("verify", "--examples", "40", behavior)
    assert code == 0, out


def test_contradicting_assumptions_are_an_error(colony: Colony, behavior: Path) -> None:
    add(behavior, "assume apart: near > 200 mm\nassume close: near < 100 mm\n")
    code, _, err = colony("verify", behavior)
    assert code == 1
    assert "error[V016]: no run of 20 frames meets `apart` where `close` holds" in err
    assert "assumed here" in err


def test_a_test_says_which_assumptions_it_breaks(colony: Colony, behavior: Path) -> None:
    add(behavior, 'assume apart: near > 200 mm\ntest "near" { at 0 s given near = 100 mm }\n')
    code, out, _ = colony("test", behavior)
    assert code == 0
    assert "  assumption apart: broken in 1 frame\n" in out
