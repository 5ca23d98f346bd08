"""Figures of docs/bench/paper-figures.md, from the finished runs of ``swashtwin bench paper``.

    swashtwin bench paper --seeds 100 --out runs
    python benchmarks/paper_figures.py runs docs/figures/paper

Nothing is computed anew but the layout of t-SNE. A figure whose experiment was not run is left out, and named.
"""

import argparse
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from swashtwin.foundation import DataError
from swashtwin_bench import PLANS, collect_studies, write_paper_page
from swashtwin_bench.results.reported import PAPER_STUDY

FIGURES = {
    "excitation": "paper_case1_*excitation",
    "waveforms": "paper_case1_*waveforms",
    "spectra": "paper_case1_*spectra",
    "identification-loss": "paper_case1_*losses",
    "identification-rates": "paper_identification_rates",
    "training-sets": "paper_case1_rows",
    "confusion": "paper_case1_confusion",
    "tsne": "paper_case1_tsne",
    "algorithms": "paper_algorithms_rows",
    "ablation": "paper_ablation_rows",
    "convergence": "paper_ablation_training",
    "related": "paper_related_rows",
    "noise": "paper_noise_*perturbation",
    "training-loss": "paper_case1_training",
}
"""Name of each figure in the documents, and pattern of its name in the report; of several the first is taken."""

IDENTIFICATION = "identification-rates"
"""Figure of searches, which are no trainings: it is that of the page that the command wrote last."""


def copy_figures(runs: Path, target: Path) -> list[str]:
    """Names of the figures that no finished run shows, after the others were copied to `target` as SVG.

    The page is drawn anew from every finished training.

    Raises
    ------
    DataError
        The folder holds no finished run, or runs of two sizes.
    """
    studies = collect_studies(runs, PLANS) if any(runs.glob(f"{PAPER_STUDY}*/*/result.json")) else []
    sizes = sorted({study.size for study in studies})
    if len(sizes) > 1 or not (studies or (runs / "paper" / "figures").is_dir()):
        raise DataError(f"{runs} holds {' and '.join(sizes) or 'no'} runs; give the --out of one size of bench paper.")
    target.mkdir(parents=True, exist_ok=True)
    missing = []
    with TemporaryDirectory() as folder:
        if studies:
            write_paper_page({study.study: study for study in studies}, sizes[0], Path(folder))
        for name, pattern in FIGURES.items():
            page = runs / "paper" if name == IDENTIFICATION else Path(folder)
            found = sorted((page / "figures").glob(f"{pattern}.svg"))
            if found:
                shutil.copyfile(found[0], target / f"{name}.svg")
            else:
                missing.append(name)
    return missing


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="folder that was given to swashtwin bench paper --out")
    parser.add_argument("target", type=Path, help="folder of the figures")
    arguments = parser.parse_args()
    for name in copy_figures(arguments.runs, arguments.target):
        print(f"no figure {name}: its experiment was not run")
