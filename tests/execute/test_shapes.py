"""What msgspec checks in place of a type: no more things of a kind than there may be."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from colony.execute import colonyc
from colony.execute.colonyc import shape


@pytest.mark.parametrize(
    ("hint", "fitting", "too_many"),
    [
        (tuple[int, ...], (1, 2, 3), (1, 2, 3, 4)),
        (dict[str, int], {"a": 1, "b": 2, "c": 3}, {"a": 1, "b": 2, "c": 3, "d": 4}),
        (tuple[tuple[int, ...], ...], ((1, 2, 3),) * 3, ((1, 2, 3, 4),)),
    ],
)
def test_more_than_the_largest_number_of_things_is_refused(
    monkeypatch: pytest.MonkeyPatch, hint: Any, fitting: object, too_many: object
) -> None:
    monkeypatch.setattr(colonyc, "MAX_ITEMS", 3)
    decoder = msgspec.msgpack.Decoder(shape(hint))
    assert decoder.decode(msgspec.msgpack.encode(fitting)) == fitting
    with pytest.raises(msgspec.ValidationError, match="length <= 3"):
        decoder.decode(msgspec.msgpack.encode(too_many))


def test_a_tuple_of_fixed_length_may_be_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(colonyc, "MAX_ITEMS", 1)
    decoder = msgspec.msgpack.Decoder(shape(tuple[str, int]))
    assert decoder.decode(msgspec.msgpack.encode(("a", 1))) == ("a", 1)
