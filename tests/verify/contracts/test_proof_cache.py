"""What is known of proofs from before, and what has to be proved again."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.verify.contracts import prove
from colony.verify.contracts.kept import ProofCache
from colony.verify.contracts.prove import results
from colony.verify.contracts.results import OverReals, ProofOptions, Proved, ProvedInTime, Refuted, Unknown

OPTIONS = ProofOptions.within(0.2, depth=1)

TEXT = """language 1
robot r {
  sensor a : mm range 0 .. 100 from PServer.a
  sensor b : mm range 0 .. 100 from PServer.b
  sensor gain : number from PServer.gain
  sensor level : number range 0 .. 100 from PServer.level
  actuator left { velocity : mm/s range -30 .. 30 }  to LServer.left  idle left(velocity = 0)
  actuator right { velocity : mm/s }  to RServer.right  idle right(velocity = 0)
}
state count = 0
next count = count + gain * gain
module one { when a > 10 mm  do left(velocity = 20 mm/s) }
module two { when b > 10 mm  do right(velocity = 20 mm/s) }
network { left = one  right = two }
contract slow: left.velocity <= 30 mm/s
contract fast: right.velocity >= 5 mm/s
contract both: left.velocity == 20 mm/s or a <= 10 mm or not fresh(a)
contract counts: count * 0.1 >= 0
contract roots: count * count * count != 7
"""


QUICK_TEXT, _ = TEXT.split("contract counts")


def program(text: str = TEXT) -> Program:
    return load_text(text)


def found(folder: Path | None, text: str = TEXT, *names: str) -> dict[str, object]:
    """Results by contract."""
    loaded = program(text)
    asked = list(names) or [c.name for c in loaded.contracts]
    cache = ProofCache(folder, loaded, OPTIONS, asked)
    return {r.contract.name: r for r in results(loaded, asked, OPTIONS, cache=cache)}


def alike(a: dict[str, object], b: dict[str, object]) -> bool:
    """Whether results are the same but for the objects that hold the texts."""
    return {name: repr(x) for name, x in a.items()} == {name: repr(x) for name, x in b.items()}


def proved_again(folder: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> list[str]:
    """The contracts that are proved though others were before."""
    again: list[str] = []
    prove_disturbed = prove.ContractProver.prove_disturbed
    with monkeypatch.context() as patched:
        patched.setattr(
            prove.ContractProver,
            "prove_disturbed",
            lambda self, contract: (again.append(contract.name), prove_disturbed(self, contract))[1],
        )
        found(folder, text)
    return again


def test_results_of_every_kind_are_the_same_the_second_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = found(tmp_path)
    kinds = {name: type(result) for name, result in first.items()}
    assert kinds == {
        "slow": Proved,
        "fast": Refuted,
        "both": ProvedInTime,
        "counts": OverReals,
        "roots": Unknown,
    }
    assert alike(first, found(None))
    monkeypatch.setattr(prove, "encode", None)
    assert alike(found(tmp_path), first)


def test_a_proof_is_known_wherever_its_declarations_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found(tmp_path, QUICK_TEXT)
    moved = proved_again(tmp_path, monkeypatch, QUICK_TEXT.replace("state", "# A comment.\nstate"))
    assert "slow" not in moved
    assert {"fast", "both"} <= set(moved)  # whose runs name places
    assert "slow" not in proved_again(tmp_path, monkeypatch, QUICK_TEXT.replace("b > 10", "b > 20"))
    assert "slow" in proved_again(tmp_path, monkeypatch, QUICK_TEXT.replace("a > 10 mm ", "a > 20 mm "))


def test_a_value_named_like_a_module_is_part_of_what_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = f"{QUICK_TEXT}let one = value_or(a, 0) > 90 mm\ncontract far: one implies value_or(a, 0) > 50 mm\n"
    found(tmp_path, text)
    assert "far" not in proved_again(tmp_path, monkeypatch, text.replace("gain * gain", "gain"))
    assert "far" in proved_again(tmp_path, monkeypatch, text.replace("0) > 90", "0) > 40"))


def test_a_contract_that_may_help_is_part_of_what_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found(tmp_path, QUICK_TEXT)
    assert "slow" in proved_again(tmp_path, monkeypatch, QUICK_TEXT.replace("== 20", "<= 25"))


def test_what_stays_unknown_alone_may_be_proved_with_others(tmp_path: Path) -> None:
    found(tmp_path, TEXT, "roots")
    files = len(list(tmp_path.iterdir()))
    found(tmp_path)
    assert len(list(tmp_path.iterdir())) == files + 5


def test_what_is_known_in_time_helps_in_time_alone(tmp_path: Path) -> None:
    text = f"{TEXT}contract meant in time: a > 10 mm and fresh(a) implies left by one\n"
    text += "contract acts: fresh(a) and a > 10 mm implies left by one\n"
    assert isinstance(found(tmp_path, text, "meant")["meant"], Proved)
    again = found(tmp_path, text, "meant", "acts")
    assert isinstance(again["meant"], Proved)
    assert isinstance(again["acts"], ProvedInTime)


@pytest.mark.parametrize("data", [b"", b"\x80", b"garbage", b"\x80\x05K\x01."])
def test_a_damaged_file_is_as_none(tmp_path: Path, data: bytes) -> None:
    first = found(tmp_path, QUICK_TEXT)
    for file in tmp_path.iterdir():
        file.write_bytes(data)
    assert alike(found(tmp_path, QUICK_TEXT), first)


def test_a_file_with_one_other_bit_or_of_another_contract_is_as_none(tmp_path: Path) -> None:
    first = found(tmp_path, QUICK_TEXT)
    files = sorted(tmp_path.iterdir())
    kept = [file.read_bytes() for file in files]
    for file, of_another in zip(files, kept[1:] + kept[:1], strict=True):
        file.write_bytes(of_another)
    assert alike(found(tmp_path, QUICK_TEXT), first)
    for place in range(0, len(kept[0]), 7):
        for file, data in zip(files, kept, strict=True):
            place %= len(data)
            file.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
        loaded = program(QUICK_TEXT)
        cache = ProofCache(tmp_path, loaded, OPTIONS, [c.name for c in loaded.contracts])
        assert not any(cache.result(contract) for contract in loaded.contracts)


def test_nothing_is_kept_where_nothing_can_be_written(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    assert alike(found(file / "proofs", TEXT, "slow"), found(None, TEXT, "slow"))
