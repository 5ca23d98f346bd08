"""Whether a recording has the rate, the channels and the unit that a model was trained on."""

from dataclasses import replace

from swashtwin.foundation import DataError
from swashtwin.learning import WindowLayout
from swashtwin.recordings import Recording


def require_layout(layout: WindowLayout, recording: Recording) -> None:
    """Refuse a recording whose rate, channels or unit are not those that a model was trained on.

    Raises
    ------
    DataError
        They differ; the message says what to do.
    """
    actual = replace(layout, sample_rate=float(recording.sample_rate), channels=recording.channels, unit=recording.unit)
    if difference := layout.difference(actual):
        raise DataError(
            f"{recording.recording_id} does not fit the model (what it was trained on against this recording): "
            f"{difference}; {_advice(difference, layout.sample_rate)}."
        )


def _advice(difference: str, rate: float) -> str:
    """What to do about a difference of layouts."""
    if difference.startswith("sample rate"):
        return f'bring it to the model\'s rate: swashtwin data convert FILE --resample "{rate:g} Hz" --out NEW.h5'
    if difference.startswith("unit"):
        return 'state what a sample is: --sensitivity with its unit, such as "50 m/s^2", or --unit'
    return (
        "say what the channels of the file are with --names, once for each, or take some of them with --channels, once "
        "for each"
    )
