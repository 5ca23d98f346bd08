"""The study of listening times tests each time on the same recordings, and calibrates in both ways."""

import json

import numpy as np
import pytest

from swashtwin.bench import ConfidenceStudySettings, ListeningStudySettings, run_listening
from swashtwin.bench.questions.listening import CONFIDENCES, METRICS
from swashtwin.foundation import InputError
from swashtwin.recordings import Recording

CYCLES = {"normal": 0.05, "piston": 0.15}
SPECIMENS = {"train": "AB", "same": "AB", "L2": "AB", "L4": "C"}
TINY = ListeningStudySettings(ConfidenceStudySettings(trained_pumps=2, length=80, error_rate=0.2))


def roles(seed: int, settings: ConfidenceStudySettings) -> dict[str, list[Recording]]:
    """Recordings of three windows at 1 kHz, two of each pump and class in each role."""
    draw, time = np.random.default_rng(seed), np.arange(3 * settings.length)
    return {
        role: [
            Recording(
                (np.sin(2 * np.pi * cycles * time + draw.uniform(0, 6)) + 2 * draw.normal(size=time.size))[None],
                1000.0,
                f"{role} {specimen} {label} {number}",
                label=label,
                specimen=specimen,
            )
            for specimen in specimens
            for label, cycles in CYCLES.items()
            for number in range(2)
        ]
        for role, specimens in SPECIMENS.items()
    }


def test_every_listening_time_has_every_figure_at_each_level_by_each_confidence(monkeypatch) -> None:
    monkeypatch.setattr("swashtwin.bench.questions.listening.record_roles", roles)
    study = run_listening(seeds=(0, 1), settings=TINY, classifiers=("ridge",))
    table = json.loads(json.dumps(study.to_dict(), allow_nan=False))
    keys = [(row["level"], row["confidence"], row["listening"]) for row in table["rows"]]
    spans = ("80 ms", "160 ms", "240 ms")
    assert sorted(keys) == sorted((level, way, span) for level in ("L2", "L4") for way in CONFIDENCES for span in spans)
    for row in table["rows"]:
        assert all(row[name]["mean"] is not None for name in METRICS)
        assert 1 <= row["set_size"]["mean"] <= 2
    assert "after 80 ms" in table["answer"][0]


def test_a_rule_without_confidence_is_refused_before_anything_is_recorded() -> None:
    with pytest.raises(InputError, match="'envelope_threshold' has no confidence; take a network or trees"):
        run_listening(classifiers=("envelope_threshold",))
