"""Proofs that hold while clients are late, and while somebody outside the network commands."""

from __future__ import annotations

import pytest

from colony.dsl.load import load_text
from colony.ir.frame import OverriddenCommand
from colony.verify.contracts.concrete_runs import Replay
from colony.verify.contracts.disturbances import with_operator_runs
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import ProofOptions, Proved, ProvedInTime, Refuted, Result

ROBOT = """
robot r {{
  sensor go   : bool default false from PServer.go
  sensor near : m range 0 .. 10 from PServer.near
  sensor up   : mm range 0 .. 500 default 0 from PServer.up
  actuator drive {{ velocity : m/s range -1 .. 1 }} to RServer.drive idle drive(velocity = 0) {loss}
  actuator lift {{ height : mm range 0 .. 500 }} to Lift.lift idle {idle}
}}
module cruise {{ when go do drive(velocity = 0.5 m/s) }}
module creep {{ when not go and up > 10 mm do drive(velocity = 0.1 m/s) }}
module raise {{ when go do lift(height = 100 mm) }}
module other {{ when not go do lift(height = up) }}
network {{ drive = cruise suppresses creep  lift = raise suppresses other }}
"""


def result(contract: str, more: str = "", idle: str = "lift(height = 0)", loss: str = "") -> Result:
    """What becomes of a contract of a robot that drives and lifts."""
    text = f"{ROBOT.format(idle=idle, loss=loss)}{more}\ncontract c: {contract}\n"
    return prove_contracts(load_text(text), ProofOptions(depth=2, max_frames=4, resources=3_000_000))[-1]


def in_time(contract: str, more: str = "", **options: str) -> ProvedInTime:
    """A contract that a run with late clients breaks."""
    found = result(contract, more, **options)
    assert isinstance(found, ProvedInTime)
    assert found.trace is not None
    return found


def always(contract: str, more: str = "", **options: str) -> Proved:
    """A contract that holds while clients are late."""
    found = result(contract, more, **options)
    assert isinstance(found, Proved)
    return found


def test_one_actuator_acts_while_the_other_is_late() -> None:
    found = in_time("drive.velocity > 0.2 m/s implies lift is commanded")
    [snapshot] = found.trace.snapshots
    assert snapshot.given == {"lift": OverriddenCommand()}
    [outcome] = found.trace.outcomes
    assert outcome.commands["lift"].by is None
    assert outcome.commands["drive"].by == "cruise"
    assert found.trace.found == ("drive by cruise, velocity = 0.5 m/s", "lift is idle, height = 0 mm")


def test_the_run_breaks_the_contract_only_because_clients_are_late() -> None:
    found = in_time("go implies drive by cruise")
    assert found.trace is not None
    replay = Replay(
        load_text(ROBOT.format(idle="lift(height = 0)", loss="") + "contract c: go implies drive by cruise"),
        "c",
    )
    assert replay.breaks(found.trace.snapshots)
    assert not replay.breaks([s._replace(given={}) for s in found.trace.snapshots])


def test_with_one_actuator_the_idle_command_must_keep_the_contract() -> None:
    in_time("go implies drive.velocity == 0.5 m/s")
    assert always("go implies drive.velocity >= 0 m/s").operators is False
    assert always("go implies drive.velocity >= 0 m/s or drive by cruise").operators is False


def test_by_is_of_nobody_and_the_actuator_is_idle() -> None:
    assert always("drive is idle implies not (drive by cruise or drive by creep)").operators
    assert always("drive is idle or drive is commanded").operators
    assert always("drive is idle implies drive.velocity == 0").operators
    assert not always("drive is commanded implies drive by cruise or drive by creep").operators


def test_modules_are_active_all_the_same() -> None:
    assert always("go implies cruise is active").operators
    in_time("cruise is active implies drive is commanded")


def test_idle_hold_holds_what_was_given_last() -> None:
    """While no client is late the lift is as high as it was told in this frame."""
    high = "go implies value_or(lift.height, 100 mm) == 100 mm"
    assert always("value_or(lift.height, 0 mm) >= 0 mm", idle="hold").operators
    found = in_time(high, idle="hold")
    assert len(found.trace.snapshots) == 2
    assert found.trace.snapshots[-1].given == {"lift": OverriddenCommand()}
    first = in_time("lift.height <= 500 mm", idle="hold")
    assert first.trace.unknown, "nothing was given yet"


def test_memory_of_contracts_is_about_what_was_given() -> None:
    in_time("rising(go) implies rising(drive.velocity > 0.2 m/s)")
    assert always("recently(drive.velocity > 2 m/s, 1 s) implies false").operators
    assert always("previous(drive.velocity, 0 m/s) <= 1 m/s").operators
    in_time("previous(cruise is active, false) implies previous(drive is commanded, false)")


LIMIT = "limit drive.velocity <= near / 1 s when near < 1 m"


def test_operators_are_held_to_the_limits() -> None:
    assert always("fresh(near) and near < 0.5 m implies drive.velocity <= 0.5 m/s", LIMIT).operators
    assert always("not fresh(near) implies drive.velocity <= 0 m/s", LIMIT).operators
    assert not always("drive.velocity in 0 .. 0.5 m/s", LIMIT).operators
    assert always("drive.velocity in -1 m/s .. 1 m/s").operators


def test_where_limits_contradict_the_actuator_is_idle_whoever_commands() -> None:
    limits = "limit drive.velocity <= 0.3 m/s when go\nlimit drive.velocity >= 0.4 m/s when go"
    assert always("go implies drive is idle and drive.velocity == 0", limits).operators


def test_a_bound_that_is_missing_on_idle_hold_keeps_operators_out() -> None:
    limit = "limit lift.height <= near"
    assert always("not fresh(near) implies lift is idle", limit, idle="hold").operators
    assert not always(
        "lift is commanded implies lift by raise or lift by other", limit, idle="hold"
    ).operators


def test_of_a_contract_in_time_no_late_clients_are_asked() -> None:
    """It helps those that are not, and commands from outside are not asked of it either."""
    text = ROBOT.format(idle="hold", loss="")
    program = load_text(
        f"{text}contract c in time: drive by cruise implies lift by raise\n"
        "contract never in time: drive.velocity <= 1 m/s\n"
        "contract wrong in time: drive by cruise\n"
    )
    held, never, wrong = prove_contracts(program)
    assert isinstance(held, Proved)
    assert isinstance(never, Proved)
    assert isinstance(wrong, Refuted)
    assert (held.operators, never.operators) == (False, False)
    assert not any(s.given for s in wrong.trace.snapshots)
    assert with_operator_runs(program, held) == held


def test_with_on_loss_degrade_lesser_modules_act() -> None:
    assert always("go implies not (drive by creep)").operators
    text = ROBOT.replace("cruise suppresses creep", "cruise suppresses slow suppresses creep")
    text += "module slow {{ when true do drive(velocity = 0.05 m/s) }}\n"
    text += "contract c: go implies not (drive by slow)"
    [found] = prove_contracts(load_text(text.format(idle="hold", loss="on_loss degrade")))
    assert isinstance(found, ProvedInTime)
    assert [s.lost for s in found.trace.snapshots] == [frozenset({"cruise"})]
    [found] = prove_contracts(load_text(text.format(idle="hold", loss="")))
    assert isinstance(found, Proved)


def test_failsafe_modules_are_not_lost() -> None:
    text = ROBOT.replace("module cruise", "failsafe module cruise").replace(
        "suppresses creep", "suppresses creep suppresses slow"
    )
    text += "module slow {{ when true do drive(velocity = 0.05 m/s) }}\n"
    text += "contract c: go implies not (drive by slow)"
    [found] = prove_contracts(load_text(text.format(idle="hold", loss="on_loss degrade")))
    assert isinstance(found, Proved)
    assert found.operators


@pytest.mark.parametrize("loss", ["", "on_loss degrade"])
def test_time_constants_of_the_network_go_on(loss: str) -> None:
    """A lost client does not dominate, so what it suppressed acts at once; without loss it holds."""
    text = ROBOT.replace("cruise suppresses creep", "cruise suppresses[1 s] creep")
    contract = "contract c: recently(go, 1 s) implies not (drive by creep)"
    [found] = prove_contracts(load_text(text.format(idle="hold", loss=loss) + contract))
    assert isinstance(found, Proved if not loss else ProvedInTime)


def test_a_contract_without_decisions_is_not_disturbed() -> None:
    assert always("up <= 500 mm").operators
