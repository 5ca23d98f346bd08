"""Whether the default network is done, on Case I, before the paper's recipe has begun.

    python benchmarks/time_to_accuracy.py --fleets 1 --times 5

Both learn from Case I's measured windows at paper size, one thread each, one after the other. The paper's recipe (full
rate, Adam 1e-3, batches of 30, 200 epochs) keeps its rate, so what it has after its first epochs is what it would have
then in the whole training; it is given as many whole epochs as fill the default's processor time `--times` over, and
two at least. Figures on the virtual rig say nothing about a real pump (docs/bench/rig.md).
"""

import argparse
import json
import math
import time
from typing import Any

import torch

from swashtwin.bench import SIZES, rig_recordings
from swashtwin.bench.rivals.models import DEFAULT, MODELS, PAPERS_OWN, Model, train_model
from swashtwin.bench.studies.cases import SCENARIOS
from swashtwin.bench.studies.dataset import StudyDataset, prepare
from swashtwin.learning import evaluate


def trained(name: str, model: Model, dataset: StudyDataset, seed: int) -> dict[str, Any]:
    """Processor time of one training [s], and the accuracies that it comes to."""
    begun = time.process_time()
    classifier = train_model(model, dataset.measured, seed=seed, manifest=dataset.manifest)
    spent = time.process_time() - begun
    scores = {level: evaluate(classifier, test, level=level).accuracy for level, test in dataset.tests.items()}
    return {"fleet": seed, "recipe": name, "epochs": model.training.epochs, "cpu_s": spent, **scores}


def of_fleet(seed: int, times: float) -> list[dict[str, Any]]:
    """The default's training, the paper's first epoch, and as many of them as fill the time."""
    recordings = [recording for recording, _ in rig_recordings(seed, SIZES["paper"])]
    dataset = prepare(recordings, SCENARIOS["paper"], seed, ())
    ours = trained(DEFAULT, MODELS["paper"][DEFAULT], dataset, seed)
    first = trained("the paper's", PAPERS_OWN.with_training(epochs=1), dataset, seed)
    epochs = max(2, math.ceil(times * ours["cpu_s"] / first["cpu_s"]))
    return [ours, first, trained("the paper's", PAPERS_OWN.with_training(epochs=epochs), dataset, seed)]


def main() -> None:
    """Print a table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", type=int, default=1, help="seeds 0... of the rig")
    parser.add_argument("--times", type=float, default=5.0, help="the default's time, how often")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = [row for seed in range(options.fleets) for row in of_fleet(seed, options.times)]
    if options.json:
        print(json.dumps({"rows": rows}))
        return
    for row in rows:
        levels = ", ".join(f"{level} {row[level]:.3f}" for level in SCENARIOS["paper"].levels)
        print(f"fleet {row['fleet']}, {row['recipe']:14s} {row['epochs']:3d} epochs {row['cpu_s']:7.0f} s: {levels}")


if __name__ == "__main__":
    main()
