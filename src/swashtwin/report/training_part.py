"""Part of the page about a training: of a classifier, or of a detector of deviations."""

from collections import Counter

import numpy as np

from swashtwin.diagnosis import AnomalyDetector, few_machines
from swashtwin.foundation import plural
from swashtwin.learning import Choice, FittedClassifier
from swashtwin.plot import words
from swashtwin.report.page import Bullets, Group, Part, Section, SectionOrder, Table
from swashtwin.report.wording import facts_table, number, percent

_NO_TEST = "Shares of a training are no test: evaluate the model on recordings that had no part in it."


def training_part(classifier: FittedClassifier, key: str) -> Part:
    """Part of the page about one classifier."""
    choice, confidence = classifier.choice, classifier.confidence
    basis = "The model's confidence is not calibrated: its scores rank the classes and are no probabilities."
    if confidence is not None:
        rate = percent(confidence.error_rate)
        basis = f"Its confidence is calibrated by {confidence.basis}, at an error rate of {rate}."
    tried = (Section(SectionOrder.SCORES, "What was tried", choice_blocks(choice)),) if choice and choice.trials else ()
    summary = {
        "classes": list(classifier.classes),
        "network": classifier.network.name,
        "recordings": sorted(classifier.manifest),
        "seed": classifier.seed,
        "choice": None if choice is None else choice.to_dict(),
    }
    return Part(
        title="Training of a model",
        answer=(() if choice is None else (choice.sentence(),)),
        sections=(
            *tried,
            Section(SectionOrder.TRAINING, "What the model was trained on", _training_blocks(classifier)),
        ),
        results={"trainings": [summary]},
        verdict=f"A model of {len(classifier.classes)} classes, from {plural(len(classifier.manifest), 'recording')}",
        certainty=(basis, *filter(None, (few_machines(classifier.training_reference),)), _NO_TEST),
        actions=(
            "Test it on recordings that had no part in it: swashtwin evaluate MODEL INDEX --report FOLDER.",
            "Then diagnose new recordings: swashtwin diagnose MODEL FILE --report page.html.",
        ),
        facts=(("Classes", ", ".join(map(words, classifier.classes))),),
    )


def detector_part(detector: AnomalyDetector) -> Part:
    """Part of the page about one detector of deviations; it has no figures."""
    healthy = detector.fitted_
    entries = [
        ("healthy recordings", healthy.n_recordings),
        ("machines and operating points", len(healthy.points)),
        ("levels compared", len(detector.layout.levels)),
        ("channels", list(detector.layout.channels)),
        ("sample rate", f"{detector.layout.sample_rate:g} Hz"),
    ]
    blocks = (Bullets("Notes", detector.notes_), facts_table("What the detector was made of.", entries))
    return Part(
        title="Training of a detector of deviations",
        answer=("It was made from healthy recordings alone: it raises an alarm, and names no fault.",),
        sections=(Section(SectionOrder.TRAINING, "What it was made of", blocks),),
        results={"detectors": [{"error_rate": detector.error_rate_, "recordings": sorted(detector.manifest)}]},
        verdict=f"A detector from {plural(healthy.n_recordings, 'healthy recording')}",
        certainty=(
            f"Its false-alarm rate is {percent(detector.error_rate_)} of the healthy recordings like these, at the "
            "machines and operating points that were recorded; elsewhere it gives no verdict.",
        ),
        actions=(
            "Judge new recordings: swashtwin diagnose MODEL FILE --report page.html.",
            "Add healthy recordings of other speeds, pressures and oil temperatures, and train again.",
        ),
    )


def _training_blocks(classifier: FittedClassifier) -> tuple[Table, ...]:
    layout, reference = classifier.layout, classifier.training_reference
    entries = [
        ("network", classifier.network.name),
        ("window", f"{layout.length} samples, {number(layout.length / layout.sample_rate)} s"),
        ("sample rate", f"{layout.sample_rate:g} Hz"),
        ("channels", list(layout.channels)),
        ("pressures [MPa]", [number(pressure / 1e6) for pressure in classifier.pressures]),
        ("speeds [rev/min]", [number(speed * 30 / np.pi) for speed in classifier.speeds]),
        ("epochs", classifier.history[-1].number if classifier.history else None),
        ("seed", classifier.seed),
    ]
    facts = facts_table("The model.", entries)
    if reference is None:
        return (facts,)
    counts = Counter(zip(reference.label, reference.specimen, strict=True))
    machines = sorted(set(reference.specimen))
    rows = tuple(
        (words(label), *(counts[label, machine] or "–" for machine in machines))
        for label in dict.fromkeys(reference.label)
    )
    header = ("class", *(machine or "machine not stated" for machine in machines))
    return (Table("Measured recordings of the training, by class and machine.", header, rows), facts)


_FEW_TRIALS = 12
"""Candidates whose table is not folded away."""


def choice_blocks(choice: Choice | None) -> tuple[str | Table | Group, ...]:
    """How a model was chosen, where training chose it."""
    if choice is None:
        return ()
    rows = tuple(
        (
            f"{trial.candidate} (chosen)" if trial.candidate == choice.chosen else trial.candidate,
            *(percent(trial.clean), percent(trial.disturbed)),
            "yes" if trial.is_tied else "",
        )
        for trial in choice.trials
    ) + tuple((f"whole recordings: {name}", percent(recall), "–", "") for name, recall in choice.whole.items())
    caption = (
        f"What training tried: share of the recordings of {choice.group}s that were left out told right, mean over the "
        f"classes, {plural(choice.n_folds, 'fold')}. One of those as good as the best within one standard error was "
        "taken."
    )
    header = ("candidate", "as measured", "with noise, gain, speed", "as good as the best")
    table = Table(caption, header, rows)
    tried = (Group(f"All {len(rows)} candidates", (table,), is_open=False),) if len(rows) > _FEW_TRIALS else (table,)
    return (choice.sentence(), *(tried if rows else ()))
