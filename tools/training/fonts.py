"""The fonts from which the network learns characters, and those on which it is only evaluated.

Some are shipped with matplotlib, and are found without importing it; the others come from small packages that
contain only font files (the extra `dev`).
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

Package = tuple[str, str]
"""A package, and the folder in it with the fonts."""

_LEARNED: dict[Package, tuple[str, ...]] = {
    ("matplotlib", "mpl-data/fonts/ttf"): (
        "DejaVuSans.ttf", "DejaVuSans-Bold.ttf", "DejaVuSansMono.ttf", "DejaVuSansMono-Bold.ttf",
        "DejaVuSerif.ttf", "DejaVuSerif-Bold.ttf", "STIXGeneral.ttf", "STIXGeneralBol.ttf",
        "cmss10.ttf", "cmtt10.ttf", "cmb10.ttf",
    ),
    ("font_caladea", "files"): ("Caladea-Regular.ttf", "Caladea-Bold.ttf"),
    ("font_hanken_grotesk", "files"): (
        "HankenGrotesk-Regular.otf", "HankenGrotesk-Medium.otf", "HankenGrotesk-SemiBold.otf",
        "HankenGrotesk-Bold.otf",
    ),
    ("font_manrope", "files"): (
        "Manrope-Regular.ttf", "Manrope-Medium.ttf", "Manrope-SemiBold.ttf", "Manrope-Bold.ttf",
        "Manrope-ExtraBold.ttf",
    ),
}  # fmt: skip

_UNSEEN: dict[Package, tuple[str, ...]] = {
    ("font_roboto", "files"): ("Roboto-Regular.ttf", "Roboto-Medium.ttf", "Roboto-Bold.ttf"),
    ("font_lato", "files"): ("Lato-Regular.ttf", "Lato-Bold.ttf", "Lato-Black.ttf"),
    ("font_source_sans_pro", "files"): (
        "SourceSansPro-Regular.otf", "SourceSansPro-Semibold.otf", "SourceSansPro-Bold.otf",
    ),
}  # fmt: skip


def learned_fonts() -> tuple[Path, ...]:
    """Return the files of the training fonts.

    Raises:
        FileNotFoundError: one is not installed.
    """
    return _installed(_LEARNED)


def unseen_fonts() -> tuple[Path, ...]:
    """Return the files of the evaluation fonts, which the training does not use.

    Raises:
        FileNotFoundError: one is not installed.
    """
    return _installed(_UNSEEN)


def _installed(wanted: dict[Package, tuple[str, ...]]) -> tuple[Path, ...]:
    fonts: list[Path] = []
    for (package, folder), names in wanted.items():
        spec = find_spec(package)
        if spec is None or spec.origin is None:
            raise FileNotFoundError(f"no package {package}, which has fonts; pip install 'colony[dev]'")
        for name in names:
            file = Path(spec.origin).parent / folder / name
            if not file.is_file():
                raise FileNotFoundError(f"no font {file}; pip install --force-reinstall {package}")
            fonts.append(file)
    return tuple(fonts)
