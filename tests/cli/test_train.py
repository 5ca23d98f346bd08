"""Any network on the command line: trained with its own settings, evaluated as any other."""

from pathlib import Path

import pytest
import typer
from commandline import one_line, run, run_json

from swashtwin.cli.options import read_settings
from swashtwin.diagnosis import load_classifier
from swashtwin.recordings import load_recordings, write_subset_index


def settings(*texts: str) -> list[str]:
    """Return the arguments that set each NAME=VALUE."""
    arguments = []
    for text in texts:
        arguments += ["--set", text]
    return arguments


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
    out = tmp_path / "model.safetensors"
    options = ("--network", network, *settings(*texts, "epochs=30"))

    run_json("train", tones, *options, "--window", 100, "--test-fraction", 0.34, "--out", out)

    trained_network = load_classifier(out).network
    assert trained_network.name == network
    assert expected.items() <= trained_network.settings.items()
    assert run_json("evaluate", out, tones)["accuracy"] > 0.8


def test_an_interrupted_training_continues_to_the_same_bits(
    tones: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # imported here, as the other tests of this file run without torch
    from swashtwin.learning.training import loop

    network = ("--network", "bitcn", *settings("channels=4,4", "epochs=2"))
    command = ("train", tones, *network, "--window", 100)
    uninterrupted = tmp_path / "straight.safetensors"
    resumed = tmp_path / "resumed.safetensors"
    run(*command, "--out", uninterrupted)
    save_checkpoint = loop.save_checkpoint

    def save_and_interrupt(*arguments: object) -> None:
        save_checkpoint(*arguments)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(loop, "save_checkpoint", save_and_interrupt)
        run(*command, "--out", resumed, code=130)
    assert not resumed.exists()

    run(*command, "--out", resumed)

    assert resumed.read_bytes() == uninterrupted.read_bytes()
    # no checkpoint is left
    assert set(tmp_path.glob("*.safetensors")) == {uninterrupted, resumed}


def test_the_recipe_of_the_paper_is_a_preset(tones: Path, tmp_path: Path) -> None:
    out = tmp_path / "paper.safetensors"
    options = ("--window", 100, "--preset", "paper", *settings("epochs=1"))

    run("train", tones, *options, "--out", out)

    classifier = load_classifier(out)
    assert classifier.network.name == "bitcn"
    assert classifier.settings.batch_size == 30
    assert classifier.settings.decay == "none"


def test_without_a_network_train_selects_one_and_calibrates_its_confidence(
    tones: Path, tmp_path: Path
) -> None:
    out = tmp_path / "chosen.safetensors"

    answer = run_json("train", tones, "--window", 100, "--out", out)

    classifier = load_classifier(out)
    assert classifier.network.name == "band_powers"
    assert classifier.choice.to_dict() == answer["choice"]
    assert classifier.confidence.cross_fitted


def usage_error(*arguments: object) -> str:
    """Return the message of a wrong command line, without its box."""
    stderr = run(*arguments, code=2).stderr
    return " ".join(stderr.replace("│", " ").split())


# The folder `nowhere` does not exist: a wrong setting is reported before any recording is read.


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        pytest.param(
            "patch=4", "training a bitcn has no setting 'patch'.", id="of another network"
        ),
        pytest.param("epoch=4", "Did you mean epochs?", id="misspelled"),
        pytest.param("stride=wide", "stride=wide must be a whole number", id="word for a number"),
        pytest.param("class_weights=1", "must be true or false", id="number for a truth value"),
        pytest.param("patch", "'patch' must be NAME=VALUE", id="without a value"),
    ],
)
def test_an_invalid_setting_is_a_wrong_command_line(text: str, reason: str) -> None:
    assert reason in usage_error("train", "nowhere", "--network", "bitcn", "--set", text)


def test_a_setting_requires_a_network() -> None:
    assert "--network" in run("train", "nowhere", "--set", "epochs=3", code=2).stderr


@pytest.mark.parametrize(
    ("network", "options", "reason"),
    [
        pytest.param(
            "bitcn", ("--set", "epochs=0"), "epochs (0) must be at least 1", id="out of range"
        ),
        pytest.param(
            "bitcn",
            ("--set", "normalization=guess"),
            "normalization (guess) must be one of",
            id="unknown choice",
        ),
        pytest.param("bi_tcn", (), "Did you mean 'bitcn'", id="unknown network"),
    ],
)
def test_an_impossible_value_is_reported_in_one_line(
    network: str, options: tuple[str, ...], reason: str
) -> None:
    line = one_line(run("train", "nowhere", "--network", network, *options, code=3))

    assert reason in line
    assert "bug" not in line


@pytest.mark.parametrize(
    ("text", "default", "value"),
    [
        ("patch=8", 4, 8),
        ("dropout=1", 0.1, 1.0),
        ("causal=false", True, False),
        ("hidden=256,128", (8, 8), (256, 128)),
        ("decay=cosine", "none", "cosine"),
        # without a default value the text decides
        ("dilations=1,2", None, (1, 2)),
    ],
)
def test_a_setting_is_read_as_the_type_of_its_default(
    text: str, default: object, value: object
) -> None:
    name = text.partition("=")[0]
    assert read_settings([text], {name: default}, "a test") == {name: value}


def test_several_settings_are_read_together() -> None:
    defaults = {"patch": 4, "decay": "none"}
    texts = ["patch=8", "decay=cosine"]
    assert read_settings(texts, defaults, "a test") == {"patch": 8, "decay": "cosine"}


def test_an_empty_list_of_numbers_is_no_setting() -> None:
    with pytest.raises(typer.BadParameter):
        read_settings(["hidden="], {"hidden": (8, 8)}, "a test")


def test_train_saves_the_faults_of_an_index_s_classes(tones: Path, tmp_path: Path) -> None:
    # the tones' index, whose class `piston` has a name of the user
    text = (tones / "recordings.toml").read_text().replace('"piston"', '"Kolbenverschleiss"')
    head, defaults = text.split("[defaults]")
    root = "" if "root =" in head else f'root = "{tones.as_posix()}"\n'
    index = tmp_path / "german.toml"
    index.write_text(f'{root}{head}[fault_of]\nKolbenverschleiss = "piston"\n[defaults]{defaults}')
    # a subset's index keeps what its original states of classes
    part = tmp_path / "part.toml"
    recordings = load_recordings(index)
    write_subset_index(index, recordings, recordings.recording_ids, part)
    out = tmp_path / "m.safetensors"
    network = ("--network", "band_powers", *settings("epochs=1"))

    run("train", part, "--window", 100, *network, "--out", out)

    assert load_classifier(out).fault_of == {"Kolbenverschleiss": "piston"}


def test_the_settings_of_the_augmentation_reach_the_training(tones: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.safetensors"
    texts = ("noise_snr=0", "gain=3", "stretch=0.02", "epochs=1")

    run(
        "train", tones, "--window", 100, "--network", "band_powers", *settings(*texts), "--out", out
    )

    augmentation = load_classifier(out).settings
    assert augmentation.noise_snr == 0.0
    assert augmentation.gain == 3.0
    assert augmentation.stretch == 0.02


@pytest.mark.parametrize(
    ("options", "code", "reason"),
    [
        pytest.param(("--test-fraction", 0.7), 2, "less than or equal to 0.5", id="test fraction"),
        pytest.param(
            ("--validation-fraction", -0.1), 2, "greater than or equal to 0", id="negative fraction"
        ),
        pytest.param(("--group", "pump_run"), 3, "pump_run", id="unspecified group"),
    ],
)
def test_an_impossible_split_is_refused_before_windows_are_cut(
    tones: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: tuple[object, ...],
    code: int,
    reason: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    # any cut would fail
    monkeypatch.delattr("swashtwin.learning.windows.cutting.cut_windows")
    monkeypatch.setattr("swashtwin.learning.cut_windows", None, raising=False)

    stderr = run("train", tones, *options, code=code).stderr

    assert reason in " ".join(stderr.replace("│", " ").split())
