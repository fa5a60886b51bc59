"""The glossary names things that there are."""

from __future__ import annotations

import re

import pytest

from tests.paths import ROOT

PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
NAMES = re.findall(r"\| `([\w.]+)` \|$", PAGE, re.MULTILINE)
CODE = {path: path.read_text(encoding="utf-8") for path in sorted((ROOT / "colony").rglob("*.py"))}
MODULES = {".".join(path.relative_to(ROOT).with_suffix("").parts) for path in CODE}
MODULES |= {name.removesuffix(".__init__") for name in MODULES}


def test_it_has_sixty_to_a_hundred_terms() -> None:
    assert 60 <= len(NAMES) <= 100
    assert len(re.findall(r"^\| (?!term|---)", PAGE, re.MULTILINE)) == len(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_name_in_the_code_is_there(name: str) -> None:
    if any(module.endswith(f".{name}") for module in MODULES):
        return
    home, _, last = name.rpartition(".")
    texts = [
        text
        for path, text in CODE.items()
        if not home
        or ".".join(path.relative_to(ROOT).with_suffix("").parts).endswith(f".{home}")
        or re.search(rf"^class {home}\b|^{home} = ", text, re.MULTILINE)
    ]
    assert any(re.search(rf"(class |def |^ *){last}\b", text, re.MULTILINE) for text in texts)
