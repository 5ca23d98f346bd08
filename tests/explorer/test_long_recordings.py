"""A recording that is too long to be transformed as a whole: its figures, and their memory."""

import base64
import threading
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
from explored import open_explorer, read_workspace
from plant import Plant
from starlette.testclient import TestClient

from swashtwin.diagnosis import load_model, save_classifier
from swashtwin.explorer import Workspace
from swashtwin.explorer import pyramid as pyramid_module
from swashtwin.explorer.excerpts import MAX_WHOLE_VALUES, excerpts
from swashtwin.explorer.pyramid import BIN, Pyramid
from swashtwin.explorer.recording_views import MAX_LINES, MIN_ORDER_RESOLUTION
from swashtwin.recordings import (
    Recording,
    inspect_recordings,
    load_recording,
    write_recording,
)

NAME = "long.wav"
RATE = 50_000
N_SAMPLES = 3 * MAX_WHOLE_VALUES
CLICK = N_SAMPLES // 3
"""A single sample in no excerpt, which the waveform shows nevertheless."""


LINES = (0.2, 0.1, 0.1)
NOISE = 0.03


def make_signal(start: int, stop: int) -> np.ndarray:
    """Return part of the recording: lines of seven pistons at 1500 rpm in noise, and the click."""
    time = np.arange(start, stop) / RATE
    signal = np.random.default_rng(start).normal(0, NOISE, stop - start)
    for harmonic, amplitude in enumerate(LINES, 1):
        signal += amplitude * np.sin(2 * np.pi * 175 * harmonic * time)
    if start <= CLICK < stop:
        signal[CLICK - start] = 0.9
    return signal


@pytest.fixture(scope="module")
def long_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a WAV file of 25 million samples, which are 201 MB in double precision."""
    folder = tmp_path_factory.mktemp("long")
    block = 1 << 20
    with soundfile.SoundFile(folder / NAME, "w", RATE, 1, subtype="PCM_16") as file:
        for start in range(0, N_SAMPLES, block):
            file.write(make_signal(start, start + block))

    facts = 'label = "normal"\nspeed = "1500 rpm"\nsensitivity = "1 m/s^2"\n'
    index = f'format = 1\n[[recording]]\nfile = "{NAME}"\n{facts}'
    (folder / "recordings.toml").write_text(index, encoding="utf-8")
    return folder


@pytest.fixture
def long_client(long_folder: Path) -> TestClient:
    """An explorer of the folder, which inspects nothing before its table is requested."""
    return open_explorer(Workspace(long_folder))


WHOLE_WAVEFORM = {"start": 0, "count": N_SAMPLES // 4**8, "width": 4**8}


def read_whole(client: TestClient, address: str, **values: object) -> Any:
    """Return the answer to a request once it knows all of the recording."""
    for _ in range(100):
        answer = client.get(f"/api/{address}", params={"name": NAME, **values})
        assert answer.status_code == 200, answer.text
        is_json = answer.headers["content-type"] == "application/json"
        known = answer.json()["known"] if is_json else float(answer.headers["x-known"])
        if known == 1:
            return answer.json() if is_json else answer.content
    raise AssertionError(f"only {known:.0%} were read")


def request_figure(client: TestClient, address: str, **values: object) -> dict[str, Any]:
    answer = client.get(f"/api/{address}", params={"name": NAME, **values})
    assert answer.status_code == 200, answer.text
    return dict(answer.json())


def test_no_figure_holds_the_recording_in_memory(long_client: TestClient) -> None:
    long_client.get("/api/twin_starts")  # loads libraries
    tracemalloc.start()
    try:
        read_whole(long_client, "samples", **WHOLE_WAVEFORM)
        read_whole(long_client, "rms")
        for kind in ("amplitude", "order", "envelope"):
            request_figure(long_client, "spectrum", kind=kind)
        request_figure(long_client, "waterfall")
        request_figure(long_client, "waterfall", orders=True)
        request_figure(long_client, "comparison", first=NAME, second=NAME)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()

    assert peak < 8 * N_SAMPLES


def test_the_waveform_shows_a_single_sample(long_client: TestClient) -> None:
    content = read_whole(long_client, "samples", **WHOLE_WAVEFORM)

    extremes = np.frombuffer(content, "<f4").reshape(-1, 2)
    width = WHOLE_WAVEFORM["width"]
    click = CLICK // width
    assert extremes[click, 1] == pytest.approx(0.9, abs=1e-3)
    assert np.delete(extremes[:, 1], click).max() < 0.7
    assert extremes[:, 0].max() < -0.2


def test_the_root_mean_square_is_that_of_all_samples(long_client: TestClient) -> None:
    rms = read_whole(long_client, "rms")

    values = np.frombuffer(base64.b64decode(rms["amplitude"]), "<f4")
    assert len(values) == rms["lines"] == 120
    expected = np.sqrt(NOISE**2 + sum(amplitude**2 / 2 for amplitude in LINES))
    np.testing.assert_allclose(values, expected, rtol=0.01)


@pytest.mark.parametrize(("kind", "position"), [("amplitude", 175), ("order", 7)])
def test_a_spectrum_is_the_mean_of_excerpts_and_says_so(
    long_client: TestClient, kind: str, position: float
) -> None:
    spectrum = request_figure(long_client, "spectrum", kind=kind)

    assert spectrum["excerpts"] == "8 excerpts of 2.62 s each"
    amplitude = np.frombuffer(base64.b64decode(spectrum["amplitude"]), "<f4")
    line = round(position / spectrum["step"])
    assert np.argmax(amplitude) == pytest.approx(line, abs=1)
    # the taper spreads a line between two positions of the grid, by 15 % at most
    assert amplitude.max() == pytest.approx(0.2, rel=0.16)


@pytest.mark.parametrize(
    ("address", "values", "source"),
    [
        ("spectrum", {"kind": "envelope"}, "5.24 s in the middle of the recording"),
        (
            "spectrum",
            {"kind": "envelope", "low": 2000, "high": 6000},
            "8 excerpts of 2.62 s each",
        ),
        ("waterfall", {}, "360 excerpts of 0.041 s each"),
        ("waterfall", {"orders": True}, "5.24 s in the middle of the recording"),
    ],
)
def test_a_figure_says_what_it_is_of(
    long_client: TestClient, address: str, values: dict[str, Any], source: str
) -> None:
    assert request_figure(long_client, address, **values)["excerpts"] == source


FLAT = np.float64(0)


@pytest.mark.parametrize(
    ("n_channels", "rate", "rpm", "min_s"),
    [
        (3, 100_000, 300, 4),
        (1, 51_200, 1500, 0.8),
        (2, 25_600, 60, 20),
        (1, 1_000_000, 6000, 0.5),
        (64, 102_400, 3000, 0.5),
        # an excerpt of twenty turns would not fit into memory
        (1, 50_000, 0.01, 10),
    ],
)
@pytest.mark.parametrize("count", [1, 8])
def test_an_excerpt_resolves_the_lines_of_the_shaft(
    n_channels: int, rate: float, rpm: float, min_s: float, count: int
) -> None:
    n_samples = 1 + 5 * MAX_WHOLE_VALUES // n_channels
    recording = Recording(
        np.broadcast_to(FLAT, (n_channels, n_samples)),
        rate,
        "long",
        channels=tuple(f"c{number}" for number in range(n_channels)),
        attributes={"speed": f"{rpm} rpm"},
    )

    parts = excerpts(recording, count)

    assert 1 <= len(parts) <= count
    assert parts[0].duration >= min_s
    assert parts[0].n_samples <= 1 << 19
    assert parts[0].n_samples * n_channels <= MAX_WHOLE_VALUES
    middle = (parts[0].n_samples + n_samples) / 2
    assert len(parts) > 1 or parts[0].n_samples < middle


def write_wav(folder: Path, signal: np.ndarray, rate: int, rpm: float) -> TestClient:
    """Open an explorer of one WAV file with a specified speed."""
    soundfile.write(folder / NAME, signal.T, rate, subtype="PCM_16")
    index = (
        f'format = 1\n[[recording]]\nfile = "{NAME}"\nspeed = "{rpm} rpm"\n'
        'sensitivity = "1 m/s^2"\n'
    )
    (folder / "recordings.toml").write_text(index, encoding="utf-8")
    return open_explorer(Workspace(folder))


@pytest.mark.parametrize(
    ("n_channels", "seconds", "rate", "rpm", "source"),
    [
        (3, 8, 100_000, 300, ""),
        (2, 11, 100_000, 600, ""),
        (1, 180, 51_200, 300, "5 excerpts of 4.1 s each"),
    ],
)
def test_an_order_spectrum_of_a_slow_shaft_is_fine(
    tmp_path: Path, n_channels: int, seconds: int, rate: int, rpm: float, source: str
) -> None:
    turns = np.arange(seconds * rate) / rate * rpm / 60
    # the piston passes, and their modulation by the shaft
    signal = 0.2 * (np.sin(2 * np.pi * 7 * turns) + np.sin(2 * np.pi * 8 * turns))
    client = write_wav(tmp_path, np.tile(signal, (n_channels, 1)), rate, rpm)

    spectrum = request_figure(client, "spectrum", kind="order")

    assert spectrum["excerpts"] == source
    # as fine as of any recording
    highest_order = rate / 2 / (rpm / 60)
    step = max(MIN_ORDER_RESOLUTION, highest_order / MAX_LINES)
    assert spectrum["step"] == pytest.approx(step, rel=0.01)
    amplitude = np.frombuffer(base64.b64decode(spectrum["amplitude"]), "<f4")
    passes, between, sideband = amplitude[np.round(np.array([7, 7.5, 8]) / step).astype(int)]
    assert between < 0.05 * min(passes, sideband)


def test_a_spectrum_of_a_pausing_machine_says_how_many_excerpts_it_is_of(tmp_path: Path) -> None:
    # the first of eight excerpts alone has a signal
    signal = np.zeros((1, MAX_WHOLE_VALUES + 1000))
    signal[0, : signal.shape[1] // 6] = make_signal(0, signal.shape[1] // 6)
    client = write_wav(tmp_path, signal, RATE, 1500)

    for kind in ("amplitude", "order"):
        spectrum = request_figure(client, "spectrum", kind=kind)
        assert spectrum["excerpts"] == "1 of 8 excerpts of 2.62 s each"


def test_a_comparison_notes_that_it_is_of_excerpts(long_client: TestClient) -> None:
    comparison = request_figure(long_client, "comparison", first=NAME, second=NAME)
    assert "long: 8 excerpts of 2.62 s each are compared." in comparison["notes"]


def write_long(recording: Recording, folder: Path) -> Path:
    """Write a recording, repeated until it is long, and return its file."""
    n_copies = 1 + MAX_WHOLE_VALUES // recording.signal.size
    long = recording.replace(signal=np.tile(recording.signal, (1, n_copies)))
    return write_recording(long, folder / "worn.h5")


def test_a_verdict_notes_that_it_is_on_an_excerpt(plant: Plant, tmp_path: Path) -> None:
    worn = load_recording(plant.worn)
    path = write_long(worn, tmp_path)
    client = open_explorer(Workspace(path), plant.model)

    verdict = client.get("/api/diagnosis", params={"name": worn.recording_id}).json()

    assert verdict["verdict"] == load_model(plant.model).diagnose(worn).verdict
    assert verdict["notes"][0] == "The verdict is on 10.2 s in the middle of the recording."
    assert not any("this very recording" in note for note in verdict["notes"])


def test_a_verdict_on_an_excerpt_says_that_the_recording_was_in_the_training(
    plant: Plant, tmp_path: Path
) -> None:
    worn = load_recording(plant.worn)
    path = write_long(worn, tmp_path)
    fitted = load_model(plant.model).fitted_
    trained = replace(fitted, manifest={"original": load_recording(path).content_hashes()})
    model = tmp_path / "model.safetensors"
    save_classifier(trained, model)
    client = open_explorer(Workspace(path), model)

    notes = client.get("/api/diagnosis", params={"name": worn.recording_id}).json()["notes"]

    trained_with = "trained with this very recording, under the name original"
    assert any(trained_with in note for note in notes), notes


def test_a_pyramid_knows_nothing_before_it_is_read_and_everything_afterwards() -> None:
    # three whole bins and a part of one, with an offset that is large against the deviation
    signal = 1e6 + np.random.default_rng(0).normal(size=(2, 3 * BIN + 5))
    pyramid = Pyramid(Recording(signal, 1000.0, "short", channels=("x", "y")))
    assert np.isnan(pyramid.extremes(BIN, 0, 9)).all()
    assert np.isnan(pyramid.rms()).all()

    assert pyramid.wait() == 1

    extremes = pyramid.extremes(2 * BIN, 0, 9)
    assert extremes.shape == (2, 2, 2)
    np.testing.assert_allclose(extremes[:, 1, 1], signal[:, 2 * BIN :].max(axis=1), rtol=1e-7)
    np.testing.assert_allclose(pyramid.rms(1)[:, 0], signal.std(axis=1), rtol=1e-6)


@pytest.mark.parametrize(
    ("missing", "n_hidden"),
    [(slice(0, 1), 0), (slice(None, None, 2), 0), (slice(5000, 5200), 2)],
    ids=["one", "every other one", "two whole parts"],
)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_missing_samples_hide_no_root_mean_square(
    missing: slice, n_hidden: int, value: float
) -> None:
    complete = 100 + np.random.default_rng(0).normal(size=(2, 10_000))
    signal = complete.copy()
    signal[0, missing] = value
    pyramid = Pyramid(Recording(signal, 1000.0, "gap", channels=("x", "y")))
    pyramid.wait()

    present = signal[0, np.isfinite(signal[0])]
    np.testing.assert_allclose(pyramid.rms(1)[:, 0], [present.std(), complete[1].std()])
    # a part without any sample has no value
    assert np.isnan(pyramid.rms()).sum(axis=1).tolist() == [n_hidden, 0]


def test_a_channel_without_samples_hides_no_other_one(tmp_path: Path) -> None:
    signal = np.random.default_rng(0).normal(size=(2, 10_000))
    signal[0] = np.nan
    recording = Recording(signal, 1000.0, "dead", channels=("x", "y"))
    workspace = read_workspace(write_recording(recording, tmp_path / "dead.h5"))

    (row,) = workspace.rows.values()
    assert np.mean(row.rms) == pytest.approx(1, rel=0.05)


def write_short(folder: Path, count: int) -> Path:
    """Write an index of recordings of one second, named r0, r1, and so on."""
    rows = []
    for number in range(count):
        signal = np.random.default_rng(number).normal(size=(1, 1000))
        recording = Recording(signal, 1000.0, f"r{number}", channels=("x",))
        write_recording(recording, folder / f"r{number}.h5")
        rows.append(f'[[recording]]\nid = "r{number}"\nfile = "r{number}.h5"\n')
    (folder / "recordings.toml").write_text("format = 1\n" + "".join(rows), encoding="utf-8")
    return folder


ERRORS = [MemoryError(), RuntimeError("a library failed"), KeyError("chunk")]


@pytest.mark.parametrize("error", ERRORS, ids=repr)
def test_samples_that_cannot_be_read_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(pyramid: Pyramid, start: int) -> None:
        raise error

    monkeypatch.setattr(Pyramid, "_read_block", fail)
    workspace = read_workspace(write_short(tmp_path, 2))
    client = open_explorer(workspace)

    assert [row.state for row in workspace.rows.values()] == ["broken", "broken"]
    for address in ("rms", "samples"):
        request = {"name": "r0", "start": 0, "count": 9, "width": BIN}
        answer = client.get(f"/api/{address}", params=request)
        assert answer.status_code == 422
        assert answer.json()["detail"] == f"r0: the samples cannot be read ({error!r})."


@pytest.mark.parametrize("error", ERRORS, ids=repr)
def test_a_recording_that_cannot_be_inspected_holds_up_no_other_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def inspect(recordings: list[Recording]) -> Any:
        if any(recording.recording_id == "r0" for recording in recordings):
            raise error
        return inspect_recordings(recordings)

    monkeypatch.setattr("swashtwin.explorer.workspace.inspect_recordings", inspect)
    workspace = read_workspace(write_short(tmp_path, 3))

    assert [row.state for row in workspace.rows.values()] == ["broken", "ready", "ready"]
    (finding,) = workspace.rows["r0"].findings
    assert finding["message"] == repr(error)
    assert workspace.table()["waiting"] == 0


class SlowReading:
    """A reading that ends no block before it may."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.n_blocks = 0
        self.may_end = threading.Event()
        monkeypatch.setattr(pyramid_module, "BLOCK_SAMPLES", 10 * BIN)
        monkeypatch.setattr(Pyramid, "_read_block", self.read)

    def read(self, start: int) -> None:
        self.n_blocks += 1
        assert self.may_end.wait(30)


def test_a_pyramid_that_nobody_keeps_stops_to_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace = Workspace(write_short(tmp_path, 5))
    reading = SlowReading(monkeypatch)
    pyramids = [workspace.pyramid(f"r{number}") for number in range(4)]
    assert pyramids[0].wait(0) == 0

    workspace.pyramid("r4")
    reading.may_end.set()
    pyramids[0].wait()

    assert reading.n_blocks == 1


def test_the_pyramid_of_the_inspected_recording_is_read_as_a_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace = Workspace(write_short(tmp_path, 6))
    reading = SlowReading(monkeypatch)
    workspace._inspected = workspace.version("r0")
    inspected = workspace.pyramid("r0")
    inspected.wait(0)

    for number in range(1, 6):
        workspace.pyramid(f"r{number}")
    reading.may_end.set()
    inspected.wait()

    assert reading.n_blocks == 2
    assert workspace.pyramid("r0") is inspected
