"""One small plant on disk for all tests: recordings of the virtual rig, and what is trained and
calibrated on them.

Each thing is built when it is first used, once for all processes that run tests side by side. No
test writes there.
"""

from collections.abc import Callable
from pathlib import Path

from build_once import built_once
from golden_rig import plant_recordings, write_workspace

from swashtwin.calibration import GaussNewton, Nuisances, calibrate
from swashtwin.diagnosis import save_classifier
from swashtwin.foundation import MPa, atomic_write, mm, rpm
from swashtwin.learning import (
    TrainingSettings,
    build_network,
    cut_windows,
    fit,
    save_windows,
)
from swashtwin.physics import Twin
from swashtwin.pump import OperatingCondition, SwashPlateDefect, load_pump
from swashtwin.recordings import Recordings, load_recordings, write_store
from swashtwin.synthesis import synthesize

AT_15 = OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15))
RECESS = SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.07))
WINDOW = 2048


class Plant:
    """Files of the plant, by what they are."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def _built(self, name: str, build: Callable[[Path], object]) -> Path:
        return built_once(self._folder / name, build)

    @property
    def folder(self) -> Path:
        """Folder of 40 recordings of four pumps and five classes at 15 MPa (``recordings/``), their
        indexes ``plant.toml``, ``pair.toml`` (two pumps, healthy and with a swash plate defect),
        ``wear.toml`` (one pump before and after) and ``specimen.toml`` (pump A), and ``csv/`` with
        a few text tables without an index.
        """

        def build(path: Path) -> None:
            path.mkdir()
            write_workspace(plant_recordings(), path)

        return self._built("files", build)

    @property
    def index(self) -> Path:
        """Index of all recordings."""
        return self.folder / "plant.toml"

    @property
    def pair(self) -> Path:
        """Index of two pumps, healthy and with a swash plate defect."""
        return self.folder / "pair.toml"

    @property
    def worn(self) -> Path:
        """Recording of pump A with a swash plate defect."""
        return self.folder / "recordings" / "A_swash_plate_15MPa_1.h5"

    @property
    def recordings(self) -> Recordings:
        """All recordings."""
        return load_recordings(self.index)

    @property
    def store(self) -> Path:
        """All recordings in one file."""
        return self._built("store.h5", lambda path: write_store(self.recordings, path))

    @property
    def calibration(self) -> Path:
        """Calibration on the healthy recordings of pump A, quick: one start, the six values
        alone.
        """

        def build(path: Path) -> None:
            healthy = self.recordings.where(label="normal", specimen="A")
            twin = Twin(load_pump("25scy14-1b"), AT_15)
            calibrate(
                twin,
                healthy,
                method=GaussNewton(starts=1),
                nuisances=Nuisances(),
                phases=False,
            ).save(path)

        return self._built("healthy.json", build)

    @property
    def synthetic(self) -> Path:
        """Three synthetic windows of a recess, like those of the pair."""

        def build(path: Path) -> None:
            like = cut_windows(load_recordings(self.pair), length=WINDOW)
            save_windows(
                synthesize(
                    Twin(load_pump("25scy14-1b"), AT_15),
                    RECESS,
                    count=3,
                    like=like,
                    seed=0,
                ),
                path,
            )

        return self._built("synthetic.safetensors", build)

    @property
    def model(self) -> Path:
        """Classifier of the pair, trained for a moment."""

        def build(path: Path) -> None:
            windows = cut_windows(load_recordings(self.pair), length=WINDOW)
            network = build_network(
                "bitcn",
                windows.n_channels,
                len(windows.classes),
                stride=32,
                channels=(8, 8),
            )
            with atomic_write(path) as temporary:
                save_classifier(
                    fit(network, windows, settings=TrainingSettings(epochs=2), seed=0),
                    temporary,
                )

        return self._built("model.safetensors", build)
