"""Calibration from recordings to result."""

import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, is_dataclass
from typing import Any

import numpy as np
import torch

from swashtwin.calibration.agreement import Spectra, Waveforms, agreement
from swashtwin.calibration.identifiability import Estimate, estimates_of, log_covariance
from swashtwin.calibration.ipinn import IPINN
from swashtwin.calibration.measurement import DEFAULT_BAND, GRAVITY, measure
from swashtwin.calibration.objective import Objective, objective_of
from swashtwin.calibration.result import Calibration
from swashtwin.calibration.search import Calibrator, Progress, Search
from swashtwin.pump import Interfaces
from swashtwin.recording import Recording
from swashtwin.twin import Twin
from swashtwin.version import VERSION


def calibrate(
    twin: Twin,
    recordings: Iterable[Recording],
    *,
    method: Calibrator | None = None,
    seed: int = 0,
    bounds: Mapping[str, tuple[float, float]] | float | None = None,
    band: tuple[float, float] | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Twin whose piston-pass lines come nearest to those of measured recordings, and how far to trust its six values.

    `recordings` may hold more than fits: used are those whose label is the twin's, whose speed is within 1 % and whose
    discharge pressure is within 6 % of the twin's; the others are listed in `Calibration.left_out`. So all known
    recordings can be given as they are, and a twin at 15 MPa is never taught at 10 MPa by mistake. Calibrating is
    training: no recording used here may stand in a test set.

    Parameters
    ----------
    twin : where to start; its interface values are the nominal ones.
    method : `IPINN` (the paper's) by default; `GaussNewton` takes a tenth of the time.
    bounds : where to search: a factor (10 by default), or (least, greatest) by parameter name or letter.
    band : frequencies [Hz] whose lines are compared; see `DEFAULT_BAND`.
    progress : called with (steps done, steps in all, loss).

    Raises
    ------
    DataError
        No recording agrees with the twin, or one is unfit.
    UnitError
        A recording is not in m/s^2.
    InputError
        Impossible bounds or band.
    """
    started = time.perf_counter()
    method = IPINN() if method is None else method
    band = DEFAULT_BAND if band is None else band
    measurement = measure(twin, recordings, band)
    objective = objective_of(twin, measurement, bounds)
    found = method.search(objective, seed=seed, progress=progress)
    covariance = log_covariance(objective, found.values, found.scales, found.nuisances)
    estimates = estimates_of(objective, found.values, covariance)
    calibrated = twin.with_interfaces(Interfaces.from_values(found.values), found.scales)
    fits, spectra, waveforms = _compared(objective, twin, calibrated)
    return Calibration(
        twin=calibrated,
        nominal=twin,
        estimates=estimates,
        covariance=covariance,
        fit_before=fits[0],
        fit_after=fits[1],
        history=found.history,
        spectra=spectra,
        waveforms=waveforms,
        recording_ids=measurement.recording_ids,
        left_out=measurement.left_out,
        notes=tuple(_notes(objective, found, estimates)),
        method=type(method).__name__,
        settings={**_settings(method), "band": list(measurement.band), "seed": seed},
        simulations=found.simulations,
        wall_s=time.perf_counter() - started,
        version=VERSION,
    )


def _compared(objective: Objective, nominal: Twin, calibrated: Twin) -> tuple[Any, Spectra, Waveforms]:
    measurement = objective.measurement
    amplitudes, fits, excerpts = [], [], []
    for twin in (nominal, calibrated):
        with torch.no_grad():
            scales = torch.tensor(twin.scales.values(), dtype=torch.float64)
            amplitudes.append(objective.amplitude(twin.values, scales=scales).numpy())
        fit, measured, simulated = agreement(measurement, twin, amplitudes[-1])
        fits.append(fit)
        excerpts.append(simulated)
    spectra = Spectra(
        channels=measurement.channels,
        orders=measurement.orders,
        frequency=measurement.orders * nominal.condition.shaft_frequency,
        measured=measurement.amplitude,
        deviation=measurement.deviation,
        nominal=amplitudes[0],
        calibrated=amplitudes[1],
    )
    times = np.arange(measured.shape[1]) / measurement.recordings[0].sample_rate
    return fits, spectra, Waveforms(times, measured, *excerpts)


def _notes(objective: Objective, found: Search, estimates: tuple[Estimate, ...]) -> list[str]:
    notes = []
    power = objective.amplitude(objective.twin.values).square().mean() / objective.measured.square().mean()
    ratio = float(power.sqrt())
    if abs(ratio / GRAVITY - 1) <= 0.2:
        notes.append(f"the nominal twin's lines are {ratio:.3g} times the measured ones: are the readings in g?")
    for estimate in estimates:
        if estimate.verdict == "at bound":
            notes.append(f"{estimate.letter} was stopped by a bound: a constant of the pump file may be wrong.")
    unknown = [estimate.letter for estimate in estimates if estimate.verdict == "not identified"]
    if unknown:
        notes.append(f"{', '.join(unknown)}: not identified; the measurement hardly says more than the bounds.")
    scales = torch.tensor(found.scales.values(), dtype=torch.float64)
    with torch.no_grad():
        lines = objective.amplitude(torch.as_tensor(found.values), scales=scales)
    misfit = float(((lines - objective.measured) / objective.sigma).square().mean().sqrt())
    if misfit > 2:
        notes.append(
            f"the calibrated lines miss the measured ones by {misfit:.2g} times what was expected; the model lacks "
            "something (housing modes, wrong constants), and the intervals were widened by as much."
        )
    return notes


def _settings(method: Calibrator) -> dict[str, Any]:
    settings = asdict(method) if is_dataclass(method) and not isinstance(method, type) else {}
    if hasattr(method, "solver"):
        settings["solver"] = repr(method.solver)
    return {name: list(value) if isinstance(value, tuple) else value for name, value in settings.items()}
