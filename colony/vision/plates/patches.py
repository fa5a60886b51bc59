"""Patches of an image at a threshold, and their merging over several thresholds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

MIN_OVERLAP = 0.62
"""Minimum intersection over union of patches that count as the same."""


class Patch(NamedTuple):
    """Columns from `left` to before `right`, rows from `top` to before `bottom`."""

    left: int
    top: int
    right: int
    bottom: int

    def scaled(self, factor: int) -> Patch:
        """Return the patch in an image that is `factor` times as large."""
        return Patch(self.left * factor, self.top * factor, self.right * factor, self.bottom * factor)

    @property
    def area(self) -> int:
        """Area in pixels."""
        return (self.right - self.left) * (self.bottom - self.top)


def merge_patches(found: Iterable[Patch]) -> tuple[Patch, ...]:
    """Merge patches that are nearly the same at several thresholds, those found most often first.

    The middle patch of each group is kept.

    Args:
        found: the patches, in the order of the thresholds.
    """
    groups: list[list[Patch]] = []
    for patch in found:
        group = next((group for group in groups if _is_same(patch, group[-1])), None)
        if group is None:
            groups.append([patch])
        else:
            group.append(patch)
    groups.sort(key=lambda group: -len(group))
    return tuple(group[len(group) // 2] for group in groups)


def _is_same(a: Patch, b: Patch) -> bool:
    width = min(a.right, b.right) - max(a.left, b.left)
    height = min(a.bottom, b.bottom) - max(a.top, b.top)
    if width <= 0 or height <= 0:
        return False
    return width * height >= MIN_OVERLAP * (a.area + b.area - width * height)
