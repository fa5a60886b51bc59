"""Who leads a run at a server: nobody takes it from a leader, except from that of a resident run."""

from __future__ import annotations

import pytest

from colony.runtime.library.clock import deploy
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import Deployment, Leadership
from tests.kit.node_stage import NodeStage, S
from tests.runtime.servers.fuzz_stage import WITH_USERS

ADA, BOB, LIMITS = (Caller(f"{name}/1", name, 0, name) for name in ("ada", "bob", "limits"))


def run(name: str, *, resident: bool = False) -> Deployment:
    return Deployment(run=name, program="p", frame_ns=50_000_000, seed=0, actuators=(), resident=resident)


def test_a_run_is_led_until_its_leader_is_lost() -> None:
    leadership = Leadership("RServer")
    assert leadership.take(ADA, run("a"))
    assert not leadership.take(ADA, run("a")), "it is deployed already"
    with pytest.raises(RefusedError, match="RServer is in the run `a`, which ada leads"):
        leadership.take(BOB, run("b"))
    leadership.on_lost(ADA)
    assert leadership.leader is None
    assert leadership.take(BOB, run("b"))
    assert leadership.leader == BOB


def test_a_resident_run_yields_and_comes_back() -> None:
    leadership = Leadership("RServer")
    assert leadership.take(LIMITS, run("limits", resident=True))
    with pytest.raises(RefusedError, match="in the run `limits`"):
        leadership.take(BOB, run("other", resident=True))
    assert leadership.take(ADA, run("a"))
    with pytest.raises(RefusedError, match="in the run `a`"):
        leadership.take(LIMITS, run("limits", resident=True))
    leadership.on_lost(LIMITS)
    assert leadership.leader == ADA
    leadership.on_lost(ADA)
    assert leadership.take(LIMITS, run("limits", resident=True))


@pytest.mark.parametrize("server", ["DServer", "RServer", "Runtime", "Lift"])
@pytest.mark.parametrize("dies", [False, True])
def test_a_server_is_in_one_run_until_its_leader_closes_or_dies(server: str, dies: bool) -> None:
    stage = NodeStage(WITH_USERS[server](), S)
    ada, bob = stage.connect("ada/1"), stage.connect("bob/1")
    for name in ("a", "a", "c"):
        ada.do(deploy(run(name)))
    problem = bob.problem(deploy(run("b")))
    assert (problem.code, problem.message) == ("busy", f"{server} is in the run `c`, which ada leads")
    if dies:
        stage.pass_time(S, alive=(bob,))
    else:
        ada.close()
    bob.do(deploy(run("b")))
