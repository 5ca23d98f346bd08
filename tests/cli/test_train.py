"""Any network on the command line: trained with its own settings, evaluated as any other."""

from pathlib import Path

import pytest
import typer
from commandline import one_line, run, run_json

from swashtwin.cli.options import read_settings
from swashtwin.diagnosis import load_classifier
from swashtwin.recordings import load_recordings, write_subset_index


def settings(*texts: str) -> list[str]:
    return [word for text in texts for word in ("--set", text)]


@pytest.mark.parametrize(
    ("network", "texts", "expected"),
    [
        ("band_powers", ("hidden=32", "gain=3"), {"hidden": 32}),
        ("bitcn", ("channels=8,8",), {"channels": (8, 8)}),
        ("extra_trees", ("trees=20",), {"trees": 20}),
    ],
)
def test_train_takes_any_network_and_its_settings(
    tones: Path, tmp_path: Path, network: str, texts: tuple[str, ...], expected: dict[str, object]
) -> None:
    words = (
        "--network",
        network,
        *settings(*texts, "epochs=30"),
        "--window",
        100,
        "--test-fraction",
        0.34,
    )
    out = tmp_path / "model.safetensors"
    run_json("train", tones, *words, "--out", out)
    trained = load_classifier(out).network
    assert trained.name == network
    assert expected.items() <= trained.settings.items()
    assert run_json("evaluate", out, tones)["accuracy"] > 0.8


def test_an_interrupted_training_goes_on_to_the_same_bits(
    tones: Path, tmp_path: Path, monkeypatch
) -> None:
    from swashtwin.learning.training import loop

    words = (
        "train",
        tones,
        "--network",
        "bitcn",
        *settings("channels=4,4", "epochs=2"),
        "--window",
        100,
    )
    straight, resumed = tmp_path / "straight.safetensors", tmp_path / "resumed.safetensors"
    run(*words, "--out", straight)
    save = loop.save_checkpoint

    def save_and_interrupt(*arguments: object) -> None:
        save(*arguments)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(loop, "save_checkpoint", save_and_interrupt)
        run(*words, "--out", resumed, code=130)
    assert not resumed.exists()
    run(*words, "--out", resumed)
    assert resumed.read_bytes() == straight.read_bytes()
    assert {path.name for path in tmp_path.glob("*.safetensors")} == {straight.name, resumed.name}


def test_the_recommended_recipe_is_the_default_and_the_paper_s_a_preset(
    tones: Path, tmp_path: Path
) -> None:
    out = tmp_path / "paper.safetensors"
    run("train", tones, "--window", 100, "--preset", "paper", *settings("epochs=1"), "--out", out)
    paper = load_classifier(out)
    assert (paper.network.name, paper.settings.batch_size, paper.settings.decay) == (
        "bitcn",
        30,
        "none",
    )
    out = tmp_path / "chosen.safetensors"
    answer = run_json("train", tones, "--window", 100, "--out", out)
    chosen = load_classifier(out)
    assert chosen.network.name == "band_powers"
    assert chosen.choice.to_dict() == answer["choice"]
    assert chosen.confidence.cross_fitted


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("patch=4", "training a bitcn has no setting 'patch'."),
        ("epoch=4", "Did you mean epochs?"),
        ("stride=wide", "stride=wide must be a whole number"),
        ("class_weights=1", "must be true or false"),
        ("patch", "'patch' must be NAME=VALUE"),
    ],
)
def test_a_setting_that_does_not_exist_is_a_wrong_command_line(text: str, reason: str) -> None:
    """It is refused before any recording is read."""
    stderr = run("train", "nowhere", "--network", "bitcn", "--set", text, code=2).stderr
    assert reason in " ".join(stderr.replace("│", " ").split())
    assert "--network" in run("train", "nowhere", "--set", "epochs=3", code=2).stderr


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("bitcn", "--set", "epochs=0"), "epochs (0) must be at least 1"),
        (("bitcn", "--set", "normalization=guess"), "normalization (guess) must be one of"),
        (("bi_tcn",), "Did you mean 'bitcn'"),
    ],
)
def test_a_value_that_cannot_be_is_one_line_before_any_recording_is_read(
    words: tuple[str, ...], reason: str
) -> None:
    line = one_line(run("train", "nowhere", "--network", *words, code=3))
    assert reason in line
    assert "bug" not in line


def test_a_setting_is_a_number_a_truth_value_a_word_or_several_numbers() -> None:
    defaults = {
        "patch": 4,
        "dropout": 0.1,
        "causal": True,
        "hidden": (8, 8),
        "decay": "none",
        "dilations": None,
    }
    texts = [
        "patch=8",
        "dropout=1",
        "causal=false",
        "hidden=256,128",
        "decay=cosine",
        "dilations=1,2",
    ]
    assert read_settings(texts, defaults, "a test") == {
        "patch": 8, "dropout": 1.0, "causal": False, "hidden": (256, 128), "decay": "cosine", "dilations": (1, 2),
    }  # fmt: skip
    with pytest.raises(typer.BadParameter):
        read_settings(["hidden="], defaults, "a test")


def test_train_takes_what_an_index_states_of_classes_and_settings_of_the_training(
    tones: Path, tmp_path: Path
) -> None:
    out, index, part = tmp_path / "m.safetensors", tmp_path / "german.toml", tmp_path / "part.toml"
    text = (tones / "recordings.toml").read_text().replace('"piston"', '"Kolbenverschleiss"')
    head, rest = text.split("[defaults]")
    root = "" if "root =" in head else f'root = "{tones.as_posix()}"\n'
    index.write_text(f'{root}{head}[fault_of]\nKolbenverschleiss = "piston"\n[defaults]{rest}')
    recordings = load_recordings(index)
    write_subset_index(index, recordings, recordings.recording_ids, part)
    texts = ("noise_snr=0", "gain=3", "stretch=0.02", "epochs=1")
    run("train", part, "--window", 100, "--network", "band_powers", *settings(*texts), "--out", out)
    trained = load_classifier(out)
    assert trained.fault_of == {"Kolbenverschleiss": "piston"}
    assert (trained.settings.noise_snr, trained.settings.gain, trained.settings.stretch) == (
        0.0,
        3.0,
        0.02,
    )


@pytest.mark.parametrize(
    ("words", "code", "reason"),
    [
        (("--test-fraction", 0.7), 2, "less than or equal to 0.5"),
        (("--validation-fraction", -0.1), 2, "greater than or equal to 0"),
        (("--group", "pump_run"), 3, "pump_run"),
    ],
)
def test_a_split_that_cannot_be_is_refused_before_windows_are_cut(
    tones: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[object, ...],
    code: int,
    reason: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delattr("swashtwin.learning.windows.cutting.cut_windows")
    monkeypatch.setattr("swashtwin.learning.cut_windows", None, raising=False)
    assert reason in " ".join(
        run("train", tones, *words, code=code).stderr.replace("│", " ").split()
    )
