"""Which contracts stay proved with the params of a site, and which values break them."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import check_text
from colony.dsl.site_reading import params_from_values
from colony.ir.program import Program
from colony.verify.contracts.kept import KeptProofs, blamed, cache_folder, kept_proofs
from colony.verify.contracts.results import ProofOptions, Refuted

TEXT = """language 1
robot r {
  sensor bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s }  to RServer.drive  idle drive(velocity = 0)
}
param cruising = 100 mm/s
param boost = 1
param offset = 0 mm/s
module go { when not bumper  do drive(velocity = cruising * boost + offset) }
network { drive = go }
contract slowly: drive.velocity <= 350 mm/s
contract never: drive.velocity < 50 mm/s
"""

OPTIONS = ProofOptions()


def program(**values: object) -> Program:
    found = check_text(TEXT, params=params_from_values(values, "<params>")).program
    assert found is not None
    return found


def kept(
    own: Program | None, site: Program, folder: Path | None
) -> tuple[KeptProofs, list[tuple[int, int, str]]]:
    calls: list[tuple[int, int, str]] = []
    found = kept_proofs(
        own, site, folder=folder, options=OPTIONS, on_progress=lambda *call: calls.append(call)
    )
    return found, calls


def test_a_contract_that_was_proved_stays_proved(tmp_path: Path) -> None:
    cache = tmp_path / "deep" / "down"
    site = program(cruising="200 mm/s")
    found, calls = kept(program(), site, cache)
    assert found == KeptProofs(proved=("slowly",), lost=())
    assert [call[:2] for call in calls] == [(0, 2), (1, 2), (2, 2), (0, 1), (1, 1)]
    assert kept(program(), site, cache) == (found, [])


def test_one_that_does_not_is_lost_and_its_run_is_known_again(tmp_path: Path) -> None:
    cache = tmp_path
    for is_first in (True, False):
        found, calls = kept(program(), program(cruising="200 mm/s", boost=2), cache)
        assert found.proved == ()
        [lost] = found.lost
        assert (lost.before, lost.result.contract.name) == ("proved", "slowly")
        assert isinstance(lost.result, Refuted)
        assert bool(calls) == is_first


def test_without_a_program_of_its_own_every_contract_must_be_proved() -> None:
    found, _ = kept(None, program(), None)
    assert found.proved == ("slowly",)
    assert [lost.result.contract.name for lost in found.lost] == ["never"]


@pytest.mark.parametrize(
    ("values", "guilty"),
    [
        ({"cruising": "400 mm/s", "boost": 1}, {"cruising"}),
        ({"cruising": "200 mm/s", "boost": 2, "offset": 0}, {"cruising", "boost"}),
        ({"offset": "10 mm/s", "boost": 4}, {"boost"}),
    ],
)
def test_the_values_that_break_a_contract(values: dict[str, object], guilty: set[str]) -> None:
    found, _ = kept(program(), program(**values), None)
    [lost] = found.lost

    def with_only(names: frozenset[str]) -> Program:
        return program(**{name: value for name, value in values.items() if name in names})

    assert blamed(lost.result, list(values), with_only) == guilty


def test_one_in_time_need_stay_proved_only_while_clients_are_in_time(tmp_path: Path) -> None:
    text = TEXT.replace(
        "contract never",
        "contract moving in time: fresh(bumper) and not bumper implies drive by go\ncontract never",
    )
    site = check_text(text, params=params_from_values({"boost": 2}, "<params>")).program
    own = check_text(text).program
    assert own is not None
    assert site is not None
    found, _ = kept(own, site, tmp_path)
    assert "moving" in found.proved


def test_the_folder_is_that_of_the_user() -> None:
    assert cache_folder({"XDG_CACHE_HOME": "/x", "HOME": "/h"}) == Path("/x/colony/proofs")
    assert cache_folder({"XDG_CACHE_HOME": "relative", "HOME": "/h"}) == Path("/h/.cache/colony/proofs")
    assert cache_folder({}) is None
