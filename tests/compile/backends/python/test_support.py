"""What generated programs bring along, without what would need imports."""

from __future__ import annotations

import ast

from colony.compile.backends.python.generate import _without_annotations

ANNOTATED = """
class Snapshot(Base, Mapping[str, object], abc.Sized):
    size: int = 0
    name: str

    def step(self, frame: Frame, *, k: int=0) -> object:
        return frame
"""
BARE = """
class Snapshot(Base, Mapping, abc.Sized):
    size = 0

    def step(self, frame, *, k=0):
        return frame
"""


def test_classes_are_bare_of_annotations_and_of_the_parameters_of_their_bases() -> None:
    (node,) = ast.parse(ANNOTATED).body
    assert isinstance(node, ast.ClassDef)
    assert ast.unparse(_without_annotations(node)) == BARE.strip()
