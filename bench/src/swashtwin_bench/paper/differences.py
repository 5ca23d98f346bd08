"""What is the same as in the paper, and what differs and why, in words; the numbers are those of the plans."""

from collections.abc import Sequence
from dataclasses import dataclass

from swashtwin.calibration import IPINN, PAPER_RATES
from swashtwin.foundation import plural
from swashtwin.learning import PAPER_TRAINING
from swashtwin_bench.paper import plans
from swashtwin_bench.rigs.writing import SIZES
from swashtwin_bench.studies.scenario import Scenario


@dataclass(frozen=True)
class Comparability:
    """What a reader must know to compare one experiment."""

    same: tuple[str, ...]
    """What is as in the paper."""
    different: tuple[str, ...]
    """What differs, and why."""


def common(size: str, precisions: Sequence[str] = ()) -> Comparability:
    """What holds for every experiment.

    Parameters
    ----------
    size : name in `plans.SIZES`.
    precisions : number formats that networks were trained in.
    """
    training, counts, paper = plans.TRAINING[size], plans.COUNTS[size], plans.COUNTS["paper"]
    rig = SIZES["small" if size == "small" else "paper"]
    smaller = () if size == "paper" else (
        f"Size medium, to end in hours: {training.epochs} epochs in place of {PAPER_TRAINING.epochs}, and the paper's "
        f"network reads patches of {plans.PATCH} samples in place of every sample. Batches and counts are the "
        "paper's.",
    ) if size == "medium" else (
        f"Size small, to end in minutes: {training.epochs} epochs in place of {PAPER_TRAINING.epochs}, batches of "
        f"{training.batch_size} in place of {PAPER_TRAINING.batch_size} so that few windows still make many steps; "
        f"{counts.windows} windows of each recording in place of {paper.windows}, {counts.scarce_windows} measured "
        f"windows in the scarce cell in place of {paper.scarce_windows}, {counts.synthetic} synthetic ones in place "
        f"of {paper.synthetic}. These figures show that every experiment runs; they do not say how good it is.",
    )  # fmt: skip
    return Comparability(
        same=(
            "Pump 25SCY14-1B at 860 rev/min and 5, 10 and 15 MPa; five classes; the swash plate fault at 15 MPa is "
            "scarce; training sets are measured windows only, with a nominal twin, or with calibrated twins; test "
            "windows are measured.",
            f"The paper's network{'' if size == 'medium' else ' at the full rate, every sample a step'}, by Adam with "
            f"a rate of {training.learning_rate:g}"
            + (
                (f", {training.epochs} epochs" if size == "paper" else "")
                + f", batches of {training.batch_size}, and the paper's counts of windows: {_counts(counts)}."
                if size != "small"
                else "."
            ),
        ),
        different=(
            *smaller,
            *(("Networks were trained in bfloat16: other roundings, less time.",) if "bfloat16" in precisions else ()),
            f"Recordings are of the virtual rig ({rig.specimens} pumps in each fleet), which is no machine; the "
            "paper's are of one real rig. The paper's figures are no target that these could meet or miss.",
            "Three accelerometers in place of thirteen, whose places on the housing are not public; swashtwin bench "
            "rig --sensor-count 13 records thirteen at places of ours.",
            "The recess is 0.07 mm deep in place of 0.6 mm, but for the experiment recess (docs/bench/rig.md).",
            "The paper prints no size of its networks, no length of a window and no scaling: these are our reading. A "
            "window is 80 ms and scaled by itself.",
            "The last epoch counts, never the one best on the test. The paper does not say which it took.",
        ),
    )


def _counts(scenario: Scenario) -> str:
    """Training windows of a plan with the paper's counts, in words."""
    measured = (scenario.class_windows or 0) - scenario.synthetic
    return (
        f"{scenario.class_windows} a class, of the swash plate fault {measured} measured ones with "
        f"{scenario.scarce_windows} of them at {scenario.pressure / 1e6:g} MPa; spread evenly, which gives 216 or 217 "
        "at each pressure"
    )


def comparability(experiment: str, size: str) -> Comparability:
    """What holds for one experiment beside what is common."""
    case_two = plans.CASE_TWO[size]
    synthetic = case_two.get("synthetic", plans.COUNTS[size].synthetic)
    return {
        "case1": Comparability(
            ("Twins fill the scarce cell with three windows for each measured one.",),
            (
                "The paper does not say whether training and test share recordings. By recording (L2) they do not. On "
                "random windows (L0) the same windows are dealt at random: a diagnosis of the leak, never a headline.",
                "The windows of the scarce cell are of one recording of one pump by recording, and of several on "
                "random windows.",
                "The paper's G-mean is of another definition: 0.9748 at an accuracy of 0.98 is below 0.9791, the least "
                "that the geometric mean of five recalls can be on its 5 × 50 test windows.",
            ),
        ),
        "case2": Comparability(
            (
                f"No measured window in the scarce cell; {synthetic} synthetic ones fill it"
                + (f"; {case_two['test_windows']} test windows a class." if "test_windows" in case_two else "."),
            ),
            (
                "On random windows (L0) only the cells of the other classes can leak, for the scarce one has nothing "
                "to deal.",
                "The paper's G-mean is of another definition (0.9029 at 0.9240 is below the least of 0.9088).",
            ),
        ),
        "recess": Comparability(
            ("The recess has the paper's length, width and depth, 30 × 24 × 0.6 mm, in recordings and in twins.",),
            (
                "Version 1-deep of the rig: films pull the slippers through the recess, which is the paper's law of "
                "contact. In 2-deep slippers lift off and strike its edge, which the paper's model does not have.",
                "Extra trees on features keep the level of a window, the paper's network does not: its windows are "
                "scaled one by one. Where the trees have everything right, the level alone is enough.",
            ),
        ),
        "algorithms": Comparability(
            ("The five networks of the paper on Case I's calibrated training set, by one recipe.",),
            (
                f"{plans.REPEATS[size]} trainings on the same data (the first fleet), as the paper's ten repeats: the "
                "spread is that of weights and order alone. Between pumps it is larger: swashtwin bench algorithms.",
                "Recurrent networks read patches of 16 samples and TCN steps of 8: 2,048 single steps can hardly be "
                "learned through.",
            ),
        ),
        "ablation": Comparability(
            (
                "A: ordinary in place of dilated causal convolution; B: no squeeze-and-excitation; C: the forward "
                "branch only.",
            ),
            (
                "Seconds are CPU seconds of one thread, which include no test. The time of one run and the figure of "
                "accuracy against time count from the last interruption.",
            ),
        ),
        "noise": Comparability(
            (f"Trained clean, tested with white noise at {', '.join(f'{snr:g}' for snr in plans.SNRS)} dB.",),
            (
                "The paper does not define its ratio. Here it is the variance of the whole recording over that of the "
                f"noise, added before windows are cut; mean of {plural(plans.noise(size).draws, 'draw')}.",
            ),
        ),
        "related": Comparability(
            ("Networks that the paper names as related work, on Case I's calibrated training set by its recipe.",),
            (
                "The paper prints no figure for them. The stacked sparse autoencoder with a deep network (SSAE-DNN) is "
                "that of Sohaib and Kim, DOI 10.1155/2018/2919637. Which graph networks the paper cites is not public "
                "in text: a graph of sensors is our reading.",
                "A graph over three sensors has little to learn from; the paper has thirteen.",
            ),
        ),
        "identification": Comparability(
            (
                f"IPINN with four convolutions, base values times magnitudes, boundary and spectrum loss, Adam, "
                f"{IPINN().epochs} epochs, rates of {', '.join(f'{rate:g}' for rate in PAPER_RATES)}; the best epoch "
                "is the result.",
            ),
            (
                "The steady vibration is solved by harmonic balance inside the loss, which gives the lines of RK4. "
                f"{'One row has' if size == 'paper' else 'Size paper has a row with'} the settled answer of RK4, found "
                "without marching in time: it checks the code and finds nothing new.",
                "Errors are measured on a recording that was held out; the paper measures them on the recordings that "
                "it identifies from.",
                "The RMSE of the waveform need not fall: the spectrum loss drops the phase, so a twin whose lines have "
                "the right amplitudes may have the wrong phases. The two rows of Gauss-Newton differ only in whether "
                "phases are compared: read their RMSE beside their SVE.",
            ),
        ),
    }[experiment]
