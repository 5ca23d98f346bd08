"""A dataclass is read back from a table or an artifact, or the entry that does not fit is named."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import msgspec
import numpy as np
import pytest
from jaxtyping import Float

from swashtwin.foundation import (
    ArtifactError,
    InputError,
    from_table,
    load_artifact,
    read_artifact,
    save_artifact,
    to_table,
    write_artifact,
)


@dataclass(frozen=True, eq=False)
class Levels:
    level: Float[np.ndarray, "recording level"]
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.names) != self.level.shape[1]:
            raise ValueError("not one name for each level")


@dataclass(frozen=True, eq=False)
class Model:
    rate: float
    levels: Levels
    weights: Mapping[str, np.ndarray]
    speed: Float[np.ndarray, " recording"] | None = None


class Machine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    limit: float = 1.0


class Plant(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    machines: tuple[Machine, ...] = ()


MODEL = Model(
    rate=np.float64(0.5),
    levels=Levels(np.arange(6.0).reshape(2, 3), ("a", "b", "c")),
    weights=MappingProxyType({"head.0.bias": np.ones(2)}),
    speed=np.array([1.0, np.nan]),
)


def load(path: Path) -> Model:
    return load_artifact(path, Model, "model", 1, advice="train again", may_be_nan=["speed"])


def test_a_dataclass_is_read_back_from_an_artifact(tmp_path: Path) -> None:
    model = load(save_artifact(tmp_path / "m.safetensors", "model", 1, MODEL, may_be_nan=["speed"]))
    assert (model.rate, model.levels.names) == (0.5, ("a", "b", "c"))
    np.testing.assert_array_equal(model.levels.level, MODEL.levels.level)
    np.testing.assert_array_equal(model.speed, MODEL.speed)
    assert np.array_equal(model.weights["head.0.bias"], np.ones(2))


def test_a_dataclass_is_read_back_from_a_table() -> None:
    table = to_table(MODEL.levels)
    assert table == {"level": [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]], "names": ("a", "b", "c")}
    np.testing.assert_array_equal(from_table(table, Levels).level, MODEL.levels.level)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": "fast"}, "rate: expected a number, got text"),
        ({"rate": None}, "rate: expected a number, got nothing"),
        (
            {"levels": {"level": {"array": "levels.level"}, "names": ["a"]}},
            "levels: not one name for each level",
        ),
        ({"levels": {"level": {"array": "speed"}, "names": ["a"]}}, "levels.level: expected"),
        ({"levels": {"level": {"array": "gone"}, "names": ["a"]}}, "'gone'"),
        ({"weights": 3}, "weights: expected a table, got a whole number"),
    ],
)
def test_a_card_that_does_not_fit_is_refused_by_entry(
    tmp_path: Path, change: dict, message: str
) -> None:
    path = save_artifact(tmp_path / "m.safetensors", "model", 1, MODEL, may_be_nan=["speed"])
    card, tensors = read_artifact(path, "model", 1, advice="", may_be_nan=["speed"])
    write_artifact(path, "model", 1, {**card, **change}, tensors, may_be_nan=["speed"])

    with pytest.raises(ArtifactError, match="does not fit this swashtwin") as caught:
        load(path)
    assert message in str(caught.value)


def test_an_unknown_entry_is_refused_with_the_likely_slip() -> None:
    with pytest.raises(
        InputError,
        match=r"^watch.toml: machines\[0\]: there is no entry 'limmit'; did you mean 'limit'\?$",
    ):
        from_table({"machines": [{"name": "a", "limmit": 2}]}, Plant, "watch.toml")

    with pytest.raises(InputError, match=r"machines\[0\]: the entry 'name' is missing\."):
        from_table({"machines": [{}]}, Plant, "watch.toml")
