"""What nobody should send: messages drawn from their own types, and what a bad sender makes of them.

A `Grammar` draws valid values of a type, by what msgspec knows of it, so that no message and no method can be
forgotten here; names, numbers of frames and the like come from small pools, so that much of it means
something to a server. A `Vandal` then changes such a value in type, size, nesting or bytes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from random import Random
from typing import Any

import msgspec
from msgspec import inspect

from colony.runtime.protocol.codec import VERSION

INTEGERS = (0, 1, -1, 2, 255, 256, -129, 2**31, 2**53, 2**63 - 1, -(2**63), 2**64 - 1)
FLOATS = (0.0, -0.0, 0.5, -1.5, 1e9, 1e308, 5e-324, math.nan, math.inf, -math.inf)
STRINGS = ("", "x", "drive", "RServer", "é", "\0", "*", "**", "a/b", "../..", "\U0001f916", "n" * 300)
BYTES = (b"", b"\xc1", b"\x00\xff" * 40)
DEEPEST = 3000
"""How deep things nest that are made to be too deep."""

Hints = Mapping[str, Callable[[Random], Any]]
"""How the fields of these names are drawn, whatever type they are of."""


NUMBERS: dict[type, tuple[object, ...]] = {
    inspect.BoolType: (False, True),
    inspect.IntType: (0, 1, 2, 5, 100, -1),
    inspect.FloatType: (0.0, 0.25, 1.0, 40.0, -40.0, 120.0),
}


class Grammar:
    """Draws valid values of types, as what msgspec makes of them: numbers, strings, lists, mappings."""

    def __init__(self, random: Random, hints: Hints) -> None:
        self._random = random
        self._hints = hints

    def draw(self, of: Any) -> Any:
        """A value of this type, one of msgspec's own or any other."""
        random = self._random
        match of if isinstance(of, inspect.Type) else _known(of):
            case inspect.StructType() as struct:
                return self._struct(struct)
            case inspect.DataclassType(fields=fields):
                return {field.encode_name: self._field(field) for field in fields}
            case inspect.NamedTupleType() as pair:
                return [self._field(field) for field in pair.fields]
            case inspect.UnionType(types=types):
                return self.draw(random.choice(types))
            case inspect.LiteralType(values=values):
                return random.choice(values)
            case inspect.VarTupleType(item_type=item) | inspect.ListType(item_type=item):
                return [self.draw(item) for _ in range(random.choice((0, 1, 2, 3, 24)))]
            case inspect.TupleType(item_types=items):
                return [self.draw(item) for item in items]
            case inspect.DictType(key_type=key, value_type=value):
                return {self.draw(key): self.draw(value) for _ in range(random.randrange(4))}
            case inspect.BoolType() | inspect.IntType() | inspect.FloatType() as number:
                return random.choice(NUMBERS[type(number)])
            case inspect.StrType():
                return random.choice(STRINGS[1:5])
            case inspect.BytesType():
                return random.choice(BYTES)
            case inspect.NoneType():
                return None
            case inspect.RawType() | inspect.AnyType():
                return self._anything()
            case other:
                raise TypeError(f"how to draw {other} is not said here")

    def _struct(self, struct: inspect.StructType) -> Any:
        values = {field.encode_name: self._field(field) for field in struct.fields}
        if struct.array_like:
            return [*([] if struct.tag is None else [struct.tag]), *values.values()]
        return values if struct.tag is None else {struct.tag_field: struct.tag, **values}

    def _field(self, field: inspect.Field) -> Any:
        hint = self._hints.get(field.encode_name)
        return self.draw(field.type) if hint is None else hint(self._random)

    def _anything(self) -> Any:
        return self._random.choice((None, True, 3, -2.5, "text", b"bytes", [1, 2], [0.5, True], {"a": [1]}))


@lru_cache(maxsize=256)
def _known(of: Any) -> inspect.Type:
    return inspect.type_info(of)


class Vandal:
    """Changes what was valid. Mutable: its random state."""

    def __init__(self, random: Random) -> None:
        self._random = random

    def message(self, tree: Any) -> bytes:
        """The bytes of a message with something wrong in it, most of the time."""
        random = self._random
        chance = random.random()
        if chance < 0.1:
            return tree_bytes(tree)
        if chance < 0.75:
            for _ in range(random.choice((1, 1, 1, 2, 4))):
                tree = self.change(tree)
            return tree_bytes(tree)
        if chance < 0.97:
            return self.damage(tree_bytes(tree))
        return random.randbytes(random.choice((0, 1, 7, 40, 300)))

    def change(self, tree: Any) -> Any:
        """The tree with one thing in it replaced, removed, doubled, added or buried."""
        random = self._random
        if isinstance(tree, list) and tree and random.random() < 0.85:
            at = random.randrange(len(tree))
            return [*tree[:at], *self._instead(tree, at), *tree[at + 1 :]]
        if isinstance(tree, dict) and tree and random.random() < 0.85:
            key = random.choice([*tree])
            rest = {k: v for k, v in tree.items() if k != key}
            match random.randrange(8):
                case 0:
                    return rest
                case 1:
                    return rest | {self.junk(0): tree[key]}
                case 2:
                    return tree | {"unknown": self.junk(1)}
                case _:
                    return tree | {key: self.change(tree[key])}
        if isinstance(tree, int) and not isinstance(tree, bool) and random.random() < 0.5:
            return max(-(2**63), min(random.choice((tree + 1, -tree, tree * 2**32)), 2**64 - 1))
        return self.junk(2)

    def _instead(self, tree: list[Any], at: int) -> list[Any]:
        match self._random.randrange(10):
            case 0:
                return []
            case 1:
                return [tree[at], tree[at]]
            case 2:
                return [tree[at], self.junk(1)]
            case 3:
                return [self._random.choice(tree)]
            case _:
                return [self.change(tree[at])]

    def junk(self, depth: int) -> Any:
        """Anything that msgpack can say."""
        random = self._random
        match random.randrange(10 if depth else 6):
            case 0:
                return random.choice(INTEGERS)
            case 1:
                return random.choice(FLOATS)
            case 2 | 3:
                return random.choice(STRINGS)
            case 4:
                return random.choice((None, True, False))
            case 5:
                return random.choice(BYTES)
            case 6:
                return [self.junk(depth - 1)] * random.choice((0, 1, 3, 200))
            case 7:
                return {self.junk(0): self.junk(depth - 1) for _ in range(random.choice((0, 1, 5)))}
            case 8:
                return msgspec.Raw(b"\x91" * random.choice((5, DEEPEST)) + b"\xc0")
            case _:
                return msgspec.msgpack.Ext(random.randrange(-128, 128), b"ext")

    def damage(self, data: bytes) -> bytes:
        """Bytes with some of them flipped, missing, doubled, or more than there were."""
        random, found = self._random, bytearray(data)
        for _ in range(random.choice((1, 1, 2, 8))):
            at = random.randrange(len(found) + 1)
            match random.randrange(5):
                case 0:
                    del found[at:]
                case 1:
                    del found[at : at + random.randrange(1, 4)]
                case 2:
                    found[at:at] = random.randbytes(random.randrange(1, 4))
                case 3:
                    found += found[at:]
                case _ if found:
                    found[at % len(found)] = random.randrange(256)
                case _:
                    pass
        return bytes(found)


def tree_bytes(tree: Any) -> bytes:
    """A message as it would go over the network."""
    return bytes([VERSION]) + _encode(tree)


_encode = msgspec.msgpack.Encoder().encode
