"""Upgrades of files: each with the program that it belongs to, because decisions depend on whole programs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from colony.dsl.descriptions import RobotChoice
from colony.dsl.files import ParsedFile, SourceTree, load_tree
from colony.dsl.robot_import import context_of_file
from colony.dsl.upgrade import UpgradedProgram, is_version_1, upgrade_tree
from colony.dsl.upgrade_decisions import decisions_about
from colony.dsl.upgrade_units import names_as_units
from colony.record import Record, record
from colony.text.diagnostics import Diagnostic, in_order


@record
class FileUpgrade(Record):
    """The upgrade of one file.

    Attributes:
        name: the file as the user named it.
        old: its text; empty if it cannot be read.
        new: its text as version 2, equal to `old` if it has the line already; None if it has errors.
        diagnostics: what a person has to decide, at places of the new text; or the errors.
        left_behind: the names of files of version 1 that it imports and that are not upgraded with it.
    """

    name: str
    old: str = ""
    new: str | None
    diagnostics: tuple[Diagnostic, ...] = ()
    left_behind: tuple[str, ...] = ()


def upgrade_files(names: Sequence[str], *, robot: RobotChoice | None = None) -> tuple[FileUpgrade, ...]:
    """Return the upgrades of files, in order, each file once; nothing is written.

    A file that has errors on its own, because it needs names of a file that imports it, is upgraded as part
    of that one, if it is among `names`. `robot` is the description that `import robot` brings in.
    """
    trees: dict[str, tuple[str, SourceTree]] = {}
    found: list[FileUpgrade] = []
    for name in names:
        tree = load_tree(Path(name), name, context=context_of_file(Path(name), robot))
        if tree.files:
            trees.setdefault(tree.files[-1].key, (name, tree))
        else:
            found.append(FileUpgrade(name=name, new=None, diagnostics=tree.diagnostics))
    programs = [upgrade_tree(tree) for _, tree in trees.values()]
    upgrades = [
        _upgrade_file(name, tree.files[-1], program, programs, written=trees.keys())
        for (name, tree), program in zip(trees.values(), programs, strict=True)
    ]
    return (*found, *upgrades)


def _upgrade_file(
    name: str,
    file: ParsedFile,
    own: UpgradedProgram,
    programs: Sequence[UpgradedProgram],
    written: Collection[str],
) -> FileUpgrade:
    old = file.source.text
    if not is_version_1(file.tree):
        own_errors = tuple(d for d in own.diagnostics if d.code == "E008" and d.span.source is file.source)
        return FileUpgrade(name=name, old=old, new=None if own_errors else old, diagnostics=own_errors)
    renamed = tuple(d for f in own.files if is_version_1(f.old.tree) for d in names_as_units(f.old))
    if renamed:
        return FileUpgrade(name=name, old=old, new=None, diagnostics=in_order(renamed))
    for upgraded in (own, *programs):
        if upgraded.program is None:
            continue
        unwritten = [f for f in upgraded.files if f.new.key not in written and is_version_1(f.old.tree)]
        for new in (f.new for f in upgraded.files):
            if new.key == file.key:
                decisions = decisions_about(upgraded.program, upgraded.diagnostics, new.source)
                return FileUpgrade(
                    name=name,
                    old=old,
                    new=new.source.text,
                    diagnostics=in_order([upgraded.with_old_places(d, unwritten) for d in decisions]),
                    left_behind=tuple(f.old.source.name for f in unwritten),
                )
    return FileUpgrade(name=name, old=old, new=None, diagnostics=own.errors_before())
