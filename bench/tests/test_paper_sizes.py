"""What the sizes of the paper's experiments have in common."""

from dataclasses import replace

from swashtwin_bench.paper import plans
from swashtwin_bench.paper.differences import common


def test_size_medium_is_the_papers_but_for_its_epochs_and_the_steps_of_its_network() -> None:
    for name in ("paper-case2", "paper-ablation", "paper-noise"):
        medium, whole = (plans.PAPER_PLANS[name](size) for size in ("medium", "paper"))
        assert (medium.scenario, medium.draws) == (whole.scenario, whole.draws)
        assert {key: model.training for key, model in medium.models.items()} == {
            key: replace(model.training, epochs=30) for key, model in whole.models.items()
        }
        strides = {
            key: (dict(model.network), medium.models[key].network.get("stride")) for key, model in whole.models.items()
        }
        assert all(
            stride == (plans.PATCH if plans.NETWORKS[key][0].startswith("bitcn") else None) and not settings
            for key, (settings, stride) in strides.items()
        )
    same, different = common("medium").same, common("medium").different
    assert "full rate" not in " ".join(same)
    assert "30 epochs" not in " ".join(same)
    assert "30 epochs in place of 200" in different[0]
    assert f"patches of {plans.PATCH} samples" in different[0]
