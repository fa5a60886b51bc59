"""Trains the network that reads door plates, tries it, and writes its weights, with what it found about them.

The same seed gives the same weights on one machine, with the same versions of NumPy, OpenCV and Pillow.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from colony.vision.letters.network import WEIGHTS_FILE, LetterNet, packed, unpacked
from colony.vision.training.fonts import learned_fonts, unseen_fonts
from colony.vision.training.learning import BATCH, Learner, learning
from colony.vision.training.trial import Score, calibrated, junk_score, plate_score

STEPS = 1_200
HEIGHTS_PX = (8.0, 10.0, 12.0, 16.0, 24.0, 40.0)

_TOLD_STEPS = 50
_CALIBRATION_LOOKS = 2_000
_JUNK_LOOKS = 1_000


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m colony.vision.training", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of all that is random (default: 1)")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"of {BATCH} samples (default: {STEPS})")
    parser.add_argument("--looks", type=int, default=60, help="to try a font at a height (default: 60)")
    weights = Path(__file__).parents[1] / "letters" / WEIGHTS_FILE
    parser.add_argument("--out", type=Path, default=weights, help="an .npz file (default: colony's own)")
    told = parser.parse_args()
    if told.seed < 0 or told.steps < 1 or told.looks < 1:
        parser.error("expected a --seed from 0 on, --steps and --looks from 1 on")
    if told.out.suffix != ".npz" or not told.out.absolute().parent.is_dir():
        parser.error(f"cannot write `{told.out}`; expected a file ending in .npz, in a folder that exists")
    net = trained(told.seed, told.steps)
    shares = tried(net, told.looks, np.random.default_rng((told.seed, 2)))
    begin = f"seed {told.seed}, {told.steps} steps of {BATCH} samples"
    end = f"sharpness {net.sharpness}, trust {net.trust}"
    facts = "\n".join((begin, *shares, end))
    print(facts)
    arrays: dict[str, Any] = {**packed(replace(net, facts=facts))}
    np.savez_compressed(told.out, **arrays)
    print(f"wrote {told.out}, {told.out.stat().st_size} bytes")


def trained(seed: int, steps: int) -> LetterNet:
    """Train the network for so many steps, round its weights as they are stored, and calibrate it."""
    random = np.random.default_rng(seed)
    fonts = learned_fonts()
    learner = Learner(random)
    losses: list[float] = []
    for loss in learning(learner, steps, fonts, random):
        losses.append(loss)
        if len(losses) % _TOLD_STEPS == 0:
            print(f"step {len(losses)}: loss {np.mean(losses[-_TOLD_STEPS:]):.3f}", flush=True)
    stored = unpacked(packed(learner.network()))
    return calibrated(stored, fonts, _CALIBRATION_LOOKS, np.random.default_rng((seed, 1)))


def tried(net: LetterNet, looks: int, random: np.random.Generator) -> list[str]:
    """Return a table of the share of single looks read right, by font and height of the characters."""
    lines = [
        "right of single looks, by the characters' height: " + ", ".join(f"{h:g} px" for h in HEIGHTS_PX)
    ]
    for title, fonts in (("learned", learned_fonts()), ("unseen", unseen_fonts())):
        scores = [[plate_score(net, font, h, looks, random) for h in HEIGHTS_PX] for font in fonts]
        for font, row in zip(fonts, scores, strict=True):
            lines.append(f"{title} {font.stem}: " + _shares(row))
        sums = [Score(*map(sum, zip(*column, strict=True))) for column in zip(*scores, strict=True)]
        lines.append(f"all {title}: " + _shares(sums))
        junk = junk_score(net, fonts, _JUNK_LOOKS, random)
        told = f"{junk.read} of {junk.looks} read as something, {junk.sure} with confidence 0.9 and more"
        lines.append(f"junk, with {title} fonts: {told}")
    return lines


def _shares(scores: Sequence[Score]) -> str:
    return " ".join(f"{score.right / score.looks:.3f}" for score in scores)


if __name__ == "__main__":
    main()
