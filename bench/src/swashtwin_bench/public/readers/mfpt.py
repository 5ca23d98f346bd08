"""Bearings of the Society for Machinery Failure Prevention Technology, and folders of the same form."""

import re
from pathlib import Path

from swashtwin.foundation import DataError
from swashtwin.recordings import Entry, Options, Recording, open_raw, recording_of
from swashtwin_bench.public.readers.files import files_below

_LABELS = {"baseline": "normal", "outerrace": "outer_race", "innerrace": "inner_race"}


def read_mfpt(folder: Path | str, *, resample: str | None = None) -> list[Recording]:
    """Every recording of the MFPT bearing set: ``.mat`` files with a structure of ``gs`` and ``sr``.

    The label is that of the file's name (``baseline_1``, ``OuterRaceFault_2``, ``InnerRaceFault_vload_3``); a file of
    another name, as in the folder of real-world examples, has none. Files without such a structure are passed over.
    ``gs`` are the samples [g], ``sr`` is the sample rate [Hz], ``rate`` the shaft's frequency [Hz] and ``load`` in
    pounds.

    Groups for an honest split: there is none that the set states. Which recordings share a bearing is not said, so no
    split of it shows transfer to another bearing; ``attributes["load"]`` and ``attributes["sample_rate_as_recorded"]``
    name what differs besides the fault.

    Parameters
    ----------
    folder : the files.
    resample : rate to bring every recording to, such as ``"48828 Hz"``; by default each keeps its own.

    Raises
    ------
    DataError
        `folder` holds no such file, or one is damaged.

    Notes
    -----
    What misleads: the baselines and three of the outer race faults are at 97 656 Hz, all else at 48 828 Hz, and the
    baselines all have one load: a network tells the classes apart by either.
    """
    folder = Path(folder)
    recordings = [
        recording for path in files_below(folder, ".mat") if (recording := _recording(path, folder, resample))
    ]
    if not recordings:
        raise DataError(f"{folder} holds no .mat file with a structure of gs and sr, as the MFPT set has them.")
    return recordings


def _recording(path: Path, folder: Path, resample: str | None) -> Recording | None:
    raw = open_raw(path, Options())
    prefix = next((name.removesuffix("gs") for name in raw.columns if name.rpartition(".")[2] == "gs"), None)
    facts = {name.removeprefix(prefix or ""): text for name, text in raw.attributes.items()}
    if prefix is None or "sr" not in facts:
        return None
    plain = re.sub(r"[^a-z]", "", path.stem.lower())
    attributes = {"sample_rate_as_recorded": f"{float(facts['sr']):g} Hz"}
    if "rate" in facts:
        attributes["speed"] = f"{float(facts['rate']) * 60:g} rpm"
    if "load" in facts:
        attributes["load"] = f"{float(facts['load']):g} lbf"
    entry = Entry(
        file=path.relative_to(folder).as_posix(),
        id=path.relative_to(folder).with_suffix("").as_posix(),
        label=next((label for word, label in _LABELS.items() if word in plain), None),
        channels=(f"{prefix}gs",),
        names=("acceleration",),
        unit="g",
        sample_rate=f"{float(facts['sr'])!r} Hz",
        resample=resample,
        attributes=attributes,
    )
    return recording_of(path, entry)
