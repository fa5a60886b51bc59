"""Trains the network that reads door plates, evaluates it, and writes its weights with the results.

The same seed gives the same weights on one machine, with the same versions of NumPy, OpenCV and Pillow.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from colony.vision.letters import decoding
from colony.vision.letters.decoding import WEIGHTS_FILE, LetterNet, packed, unpacked
from tools.training.fonts import learned_fonts, unseen_fonts
from tools.training.learning import BATCH_SIZE, Learner, train_steps
from tools.training.trial import Score, calibrate, junk_score, plate_score

STEPS = 1_200
HEIGHTS_PX = (8.0, 10.0, 12.0, 16.0, 24.0, 40.0)

_REPORT_STEPS = 50
_CALIBRATION_SAMPLES = 2_000
_JUNK_SAMPLES = 1_000


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tools.training", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="seed of all random numbers (default: 1)")
    parser.add_argument(
        "--steps", type=int, default=STEPS, help=f"steps of {BATCH_SIZE} samples (default: {STEPS})"
    )
    parser.add_argument(
        "--samples", type=int, default=60, help="samples per font and height in the evaluation (default: 60)"
    )
    weights = Path(decoding.__file__).parent / WEIGHTS_FILE
    parser.add_argument(
        "--out", type=Path, default=weights, help="the .npz file to write (default: Colony's own)"
    )
    options = parser.parse_args()
    if options.seed < 0 or options.steps < 1 or options.samples < 1:
        parser.error("expected --seed of at least 0, --steps and --samples of at least 1")
    if options.out.suffix != ".npz" or not options.out.absolute().parent.is_dir():
        parser.error(f"cannot write `{options.out}`; expected a file ending in .npz, in a folder that exists")
    net = train(options.seed, options.steps)
    accuracy_lines = evaluate(net, options.samples, np.random.default_rng((options.seed, 2)))
    begin = f"seed {options.seed}, {options.steps} steps of {BATCH_SIZE} samples"
    end = f"calibration: sharpness {net.sharpness}, trust in the prior {net.trust}"
    facts = "\n".join((begin, *accuracy_lines, end))
    print(facts)
    arrays: dict[str, Any] = {**packed(replace(net, facts=facts))}
    np.savez_compressed(options.out, **arrays)
    print(f"wrote {options.out}, {options.out.stat().st_size} bytes")


def train(seed: int, steps: int) -> LetterNet:
    """Train the network, round its weights as they are stored, and calibrate it."""
    random = np.random.default_rng(seed)
    fonts = learned_fonts()
    learner = Learner(random)
    losses: list[float] = []
    for loss in train_steps(learner, steps, fonts, random):
        losses.append(loss)
        if len(losses) % _REPORT_STEPS == 0:
            print(f"step {len(losses)}: loss {np.mean(losses[-_REPORT_STEPS:]):.3f}", flush=True)
    stored = unpacked(packed(learner.network()))
    return calibrate(stored, fonts, _CALIBRATION_SAMPLES, np.random.default_rng((seed, 1)))


def evaluate(net: LetterNet, count: int, random: np.random.Generator) -> list[str]:
    """Return a table of the fractions of samples read correctly, by font and height of the characters."""
    lines = [
        "fraction read correctly from single images, by character height: "
        + ", ".join(f"{h:g} px" for h in HEIGHTS_PX)
    ]
    for title, fonts in (("learned", learned_fonts()), ("unseen", unseen_fonts())):
        scores = [[plate_score(net, font, h, count, random) for h in HEIGHTS_PX] for font in fonts]
        for font, row in zip(fonts, scores, strict=True):
            lines.append(f"{title} {font.stem}: " + _fractions(row))
        sums = [Score(*map(sum, zip(*column, strict=True))) for column in zip(*scores, strict=True)]
        lines.append(f"all {title}: " + _fractions(sums))
        junk = junk_score(net, fonts, _JUNK_SAMPLES, random)
        result = f"{junk.read} of {junk.samples} read as something, {junk.sure} with confidence 0.9 and more"
        lines.append(f"junk, with {title} fonts: {result}")
    return lines


def _fractions(scores: Sequence[Score]) -> str:
    return " ".join(f"{score.correct / score.samples:.3f}" for score in scores)


if __name__ == "__main__":
    main()
