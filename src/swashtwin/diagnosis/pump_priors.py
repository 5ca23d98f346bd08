"""Priors of pumps: trained on virtual ones, read from a file, or shipped."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from swashtwin.diagnosis.prior_classifier import PriorClassifier
from swashtwin.foundation import InputError
from swashtwin.learning import fit_forest
from swashtwin.pump import Pump, is_healthy
from swashtwin.recordings import Manifest
from swashtwin.signals import OrderBands

SHIPPED = Path(__file__).parent / "priors"
"""Folder of the shipped priors, one for each design."""


def fit_prior(
    bands: OrderBands,
    change: Float[np.ndarray, "recording channel band"],
    label: Shaped[np.ndarray, " recording"],
    *,
    pump: Pump,
    speed: tuple[float, float],
    pressure: tuple[float, float],
    n_pumps: int,
    manifest: Manifest | None = None,
    seed: int = 0,
) -> PriorClassifier:
    """Classifier trained on the changes of virtual pumps (`synthesis.simulate_changes`).

    Parameters
    ----------
    bands, change, label : as of `synthesis.OrderChanges`.
    pump : the design.
    speed, pressure : ranges that the pumps were drawn from [rad/s, Pa].
    n_pumps : how many were drawn.
    manifest : recordings of a population that the virtual pumps are like.

    Raises
    ------
    InputError
        There are fewer than two classes, or the first is not healthy.
    """
    classes = tuple(dict.fromkeys(label.tolist()))
    if len(classes) < 2 or not is_healthy(classes[0]):
        raise InputError(
            "a prior needs two classes at least, the healthy one first; the virtual pumps show "
            f"{', '.join(classes) or 'none'}."
        )
    target = np.array([classes.index(name) for name in label.tolist()], dtype=np.int64)
    forest = fit_forest(np.asarray(change, dtype=np.float64).reshape(len(change), -1), target, len(classes), seed=seed)
    return PriorClassifier(
        pump=pump.name,
        bands=bands,
        channels=pump.channels,
        classes=classes,
        speed=speed,
        pressure=pressure,
        n_pumps=n_pumps,
        forest=forest,
        levels=np.empty((0, *change.shape[1:])),
        manifest={} if manifest is None else manifest,
    )


def load_prior(name: Path | str) -> PriorClassifier:
    """Prior in a file, or the shipped one of a design, such as ``"25scy14-1b"``.

    Raises
    ------
    MissingFileError
        There is no such file.
    InputError
        No prior of this design is shipped.
    ArtifactError
        The file is damaged, edited, something else, or of another version.
    """
    if Path(name).suffix == ".safetensors":
        return PriorClassifier.load(name)
    shipped = {path.stem: path for path in sorted(SHIPPED.glob("*.safetensors"))}
    if str(name) not in shipped:
        raise InputError(
            f"no prior of the design {name} is shipped (there is {', '.join(shipped)}); make one with swashtwin twin "
            "prior --pump FILE, and give its file."
        )
    return PriorClassifier.load(shipped[str(name)])
