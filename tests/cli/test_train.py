"""Any network on the command line: trained with its own settings, evaluated as any other."""

from pathlib import Path

import numpy as np
import pytest
from commandline import one_line, run, run_json

from swashtwin.cli.options import settings_of
from swashtwin.diagnosis import load_classifier


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An index of six text tables of two classes."""
    draw = np.random.default_rng(0)
    for index, label in enumerate(("normal", "piston")):
        for number in range(3):
            tone = np.sin(2 * np.pi * (0.05 + 0.1 * index) * np.arange(600) + draw.uniform(0, 6))
            rows = "\n".join(f"{value:.6f}" for value in tone + 0.1 * draw.standard_normal(600))
            (tmp_path / f"{label}_{number}.csv").write_text(f"x\n{rows}\n")
    run("index", tmp_path, "--sample-rate", "2 kHz", "--unit", "g")
    return tmp_path


@pytest.mark.parametrize(
    ("network", "settings", "expected"),
    [("bigru", ("patch=4", "hidden=8"), {"patch": 4, "hidden": 8}), ("mlp", ("hidden=32,16",), {"hidden": (32, 16)})],
)
def test_train_takes_any_network_and_its_settings(
    folder: Path, network: str, settings: tuple[str, ...], expected: dict[str, object]
) -> None:
    out = folder / "model.safetensors"
    options = [word for setting in settings for word in ("--setting", setting)]
    run_json(
        "train", folder, "--network", network, *options, "--epochs", 30, "--length", 100, "--out", out,
        "--test-fraction", 0.34,
    )  # fmt: skip
    trained = load_classifier(out).network
    assert trained.name == network
    assert expected.items() <= trained.settings.items()
    assert run_json("evaluate", out, folder)["accuracy"] > 0.8


def test_train_refuses_what_is_no_setting_of_the_network(folder: Path) -> None:
    told = one_line(run("train", folder, "--network", "lstm", "--setting", "stride=4", "--length", 100, code=3))
    assert "stride" in told
    assert "must be a number" in run("train", folder, "--setting", "patch=wide", "--length", 100, code=2).stderr
    assert "Did you mean 'bilstm'" in one_line(run("train", folder, "--network", "bi_lstm", "--length", 100, code=3))


@pytest.mark.parametrize("word", ["n_channels", "n_classes", "name"])
def test_what_the_recordings_or_another_option_say_is_no_setting(folder: Path, word: str) -> None:
    told = run("train", folder, "--setting", f"{word}=3", "--length", 100, code=2).stderr
    assert f"{word} is no setting" in " ".join(told.split())


@pytest.mark.parametrize("setting", ["frame=0.5", "frame=1", "n_bands=2.5"])
def test_a_setting_that_cannot_be_is_one_line_and_no_bug(folder: Path, setting: str) -> None:
    told = one_line(run("train", folder, "--setting", setting, "--length", 100, code=3))
    assert setting.split("=")[0] in told
    assert "bug" not in told


def test_a_setting_is_a_number_a_truth_or_several_numbers() -> None:
    texts = ["patch=8", "dropout=0.2", "causal=false", "hidden=256,128"]
    assert settings_of(texts, "--setting") == {"patch": 8, "dropout": 0.2, "causal": False, "hidden": (256, 128)}


def test_train_learns_with_noise_where_told(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.safetensors"
    run("train", folder, "--length", 100, "--noise-snr", 0, "--epochs", 2, "--out", out)
    assert load_classifier(out).settings.noise_snr == 0.0
    told = one_line(run("train", folder, "--length", 100, "--noise-snr", 0, "--normalization", "recording", code=3))
    assert "take another normalization" in told


def test_train_learns_from_other_gains_and_speeds_where_told(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.safetensors"
    run("train", folder, "--length", 100, "--gain", 3, "--stretch", 0.02, "--epochs", 2, "--out", out)
    settings = load_classifier(out).settings
    assert (settings.gain, settings.stretch) == (3.0, 0.02)
    assert "must be between 0 and 0.2" in one_line(run("train", folder, "--length", 100, "--stretch", 2, code=3))
