"""Training of the reader: its gradients are right, its steps lower the loss, a seed gives the same again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from colony.vision.letters.decoding import CLASSES
from colony.vision.plates.reader import reading_of
from tools.training import __main__ as command
from tools.training import fonts as fonts_module
from tools.training.ctc import ctc_loss
from tools.training.fonts import learned_fonts, unseen_fonts
from tools.training.layers import Convolution, Normalization, Pooling, TrainableLayer
from tools.training.learning import Learner, train_steps
from tools.training.samples import Batch, batch


def test_the_gradient_of_the_loss_is_what_small_changes_make() -> None:
    random = np.random.default_rng(1)
    scores = random.normal(0.0, 1.0, (3, 7, CLASSES)).astype(np.float32)
    texts = ["11A", "", "7"]
    _, gradient = ctc_loss(scores, texts)
    for place in [(0, 0, 1), (0, 3, 36), (0, 5, 10), (1, 2, 36), (1, 6, 4), (2, 4, 7), (2, 0, 0)]:
        higher, lower = scores.copy(), scores.copy()
        higher[place] += 0.05
        lower[place] -= 0.05
        change = (ctc_loss(higher, texts)[0] - ctc_loss(lower, texts)[0]) / 0.1
        assert gradient[place] == pytest.approx(change, rel=2e-2, abs=2e-4)


@pytest.mark.parametrize(
    "layer",
    [
        Convolution((3, 3), (2, 4), (1, 1), np.random.default_rng(2)),
        Convolution((2, 1), (2, 3), (0, 0), np.random.default_rng(3), last=True),
        Normalization(2),
        Pooling((2, 2)),
    ],
    ids=["convolution", "last", "normalization", "pooling"],
)
def test_gradients_of_layers_are_what_small_changes_make(layer: TrainableLayer) -> None:
    random = np.random.default_rng(4)
    x = random.normal(0.0, 1.0, (2, 4, 6, 2)).astype(np.float32)
    weights = random.normal(0.0, 1.0, layer.forward(x).shape).astype(np.float32)

    def loss() -> float:
        return float((layer.forward(x).astype(np.float64) * weights).sum())

    loss()
    by_input = layer.backward(weights)
    wanted = [(x, by_input), *((p.value, p.gradient.copy()) for p in layer.parameters())]
    for values, gradient in wanted:
        for place in [(0,) * values.ndim, tuple(n - 1 for n in values.shape)]:
            old = values[place]
            values[place] = old + np.float32(2e-3)
            high = loss()
            values[place] = old - np.float32(2e-3)
            low = loss()
            values[place] = old
            assert gradient[place] == pytest.approx((high - low) / 4e-3, rel=3e-2, abs=3e-3)


def test_steps_lower_the_loss() -> None:
    random = np.random.default_rng(5)
    samples = batch(16, learned_fonts(), random)
    learner = Learner(random)
    losses = [learner.step(samples, 2e-3) for _ in range(12)]
    assert losses[-1] < 0.5 * losses[0]


def test_a_seed_gives_the_same_network_again() -> None:
    def weights() -> list[np.ndarray]:
        random = np.random.default_rng(6)
        learner = Learner(random)
        list(train_steps(learner, 2, learned_fonts()[:2], random))
        return [layer.kernel for layer in learner.network().layers]

    for one, other in zip(weights(), weights(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_was_learned_is_read() -> None:
    random = np.random.default_rng(7)
    drawn = batch(64, learned_fonts(), random)
    plates = [i for i, text in enumerate(drawn.texts) if text][:6]
    junk = [i for i, text in enumerate(drawn.texts) if not text][:4]
    samples = Batch(drawn.strips[plates + junk], [drawn.texts[i] for i in plates + junk])
    learner = Learner(random)
    for _ in range(110):
        learner.step(samples, 3e-3)
    net = learner.network()
    outputs = [net.run(strip) for strip in samples.strips]
    assert (
        sum(reading_of(output, net).text == text for output, text in zip(outputs, samples.texts, strict=True))
        >= 9
    )
    assert min(output.plate_log_odds for output in outputs[:6]) > max(
        output.plate_log_odds for output in outputs[6:]
    )


def test_no_font_is_both_learned_and_unseen() -> None:
    families = {font.parent for font in learned_fonts()}
    assert families.isdisjoint(font.parent for font in unseen_fonts())


def test_a_missing_font_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fonts_module, "_LEARNED", {("font_of_nobody", "files"): ("A.ttf",)})
    with pytest.raises(FileNotFoundError, match="no package font_of_nobody"):
        learned_fonts()
    monkeypatch.setattr(fonts_module, "_LEARNED", {("matplotlib", "mpl-data/fonts/ttf"): ("Nobody.ttf",)})
    with pytest.raises(FileNotFoundError, match=r"no font .*Nobody\.ttf"):
        learned_fonts()


def test_fonts_are_files() -> None:
    assert all(isinstance(font, Path) and font.is_file() for font in (*learned_fonts(), *unseen_fonts()))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "weights"], "expected a file ending in .npz"),
        (["--out", "/nowhere/w.npz"], "in a folder that exists"),
        (["--seed", "-1"], "expected --seed of at least 0"),
        (["--steps", "0"], "--steps and --samples of at least 1"),
        (["--samples", "0"], "--steps and --samples of at least 1"),
    ],
)
def test_what_could_not_end_well_is_refused_before_it_is_trained(
    arguments: list[str], message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["training", *arguments])
    monkeypatch.setattr(command, "train", lambda *_: pytest.fail("it began"))
    with pytest.raises(SystemExit, match="2"):
        command.main()
    assert message in capsys.readouterr().err
