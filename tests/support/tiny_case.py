"""Case I on a rig so small that it takes seconds."""

from dataclasses import replace
from typing import Any

from swashtwin.calibration import GaussNewton
from swashtwin.learning import TrainingSettings
from swashtwin.recordings import Recording
from swashtwin_bench import Plan, build_plan, rig_recordings
from swashtwin_bench.rigs.writing import RigSize
from swashtwin_bench.rivals.baselines import UNSCALED
from swashtwin_bench.rivals.models import Model
from swashtwin_bench.studies.scenario import Scenario

TINY = Scenario(windows=2, scarce_windows=3, synthetic=6, held_out=1, method=GaussNewton(starts=1))
NETWORK = Model(
    "bitcn",
    {"stride": 32, "channels": (8, 8)},
    TrainingSettings(epochs=1, normalization="set"),
)
FOREST = Model("extra_trees", {"trees": 20}, UNSCALED)


def tiny(study: str = "case1", **changes: Any) -> Plan:
    plan = build_plan(study)
    few = {
        "scarce_windows": plan.scenario.scarce_windows and 3,
        "synthetic": 6,
        "test_windows": None,
    }
    scenario = replace(plan.scenario, windows=2, held_out=1, method=GaussNewton(starts=1), **few)
    models = {name: NETWORK if model.is_network else FOREST for name, model in plan.models.items()}

    return replace(plan, **{"scenario": scenario, "models": models, **changes})


def tiny_recordings() -> list[Recording]:
    return [
        recording
        for recording, _ in rig_recordings(0, RigSize(specimens=3, repeats=2, duration=1.2))
    ]
