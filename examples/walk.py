"""The main data flow, step by step; the README shows it, and a test runs it."""

from swashtwin import (
    BiTCN,
    MPa,
    OperatingCondition,
    SwashPlateDefect,
    Twin,
    calibrate,
    cut_windows,
    diagnose,
    evaluate,
    fit,
    load_pump,
    load_recordings,
    mm,
    rpm,
    split_by_recording,
    synthesize,
    write_report,
)

recordings = load_recordings("rig/")
train, test = split_by_recording(cut_windows(recordings, length=2048), test_fraction=0.2, seed=0)
worn_at_15 = Twin(
    load_pump("25scy14-1b"),
    OperatingCondition(speed=rpm(860), discharge_pressure=MPa(15)),
    SwashPlateDefect(length=mm(30), width=mm(24), depth=mm(0.6)),
)
known = recordings.where(label="swash_plate", ids=train.recording_id)  # never the test's
calibration = calibrate(worn_at_15, known, seed=0)
synthetic = synthesize(calibration, worn_at_15.fault, count=150, like=train, seed=0)
classifier = fit(BiTCN(train.n_channels, len(train.classes)), train + synthetic, seed=0)
scores = evaluate(classifier, test)
diagnosis = diagnose(classifier, recordings[0])
write_report(diagnosis, scores, calibration, folder="report/")
