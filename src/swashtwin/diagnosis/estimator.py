"""What scikit-learn asks of an estimator, without its import."""

import inspect
from collections.abc import Mapping
from functools import cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, get_args, get_origin

from swashtwin.foundation import InputError

_KINDS = {
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    str: (str, "text"),
    bool: (bool, "True or False"),
    Mapping: (Mapping, "a mapping by name"),
    NoneType: (NoneType, "None"),
}
"""What each annotation of a parameter takes, and in words."""


class Estimator:
    """Parameters of the constructor by name, and whether it is trained, which is when it has
    ``fitted_``.
    """

    @classmethod
    @cache
    def _defaults(cls) -> dict[str, Any]:
        """Default of each parameter of the constructor."""
        items = inspect.signature(cls.__init__).parameters.values()
        return {item.name: item.default for item in items if item.name != "self"}

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters of the constructor by name."""
        return {name: getattr(self, name) for name in self._defaults()}

    def set_params(self, **parameters: Any) -> "Estimator":
        """The same classifier with other parameters."""
        for name, value in parameters.items():
            if name not in self._defaults():
                raise ValueError(
                    f"{type(self).__name__} has no parameter {name!r}; it has {', '.join(self._defaults())}."
                )
            setattr(self, name, value)
        return self

    def _require_parameters(self) -> None:
        """Refuse a parameter that is nothing of what its annotation says with an `InputError`."""
        for name, value in self.get_params().items():
            stated = inspect.signature(type(self).__init__).parameters[name].annotation
            options = get_args(stated) if isinstance(stated, UnionType) else (stated,)
            types = [get_origin(option) or option for option in options]
            kinds = [
                _KINDS.get(kind, (kind, f"a {getattr(kind, '__name__', kind)}")) for kind in types
            ]
            if not any(
                isinstance(value, kind) and (kind is bool or value is not True) for kind, _ in kinds
            ):
                words = " or ".join(word for _, word in kinds)
                raise InputError(f"{name} ({value!r}) must be {words}.", field=name)

    def __repr__(self) -> str:
        other = (
            f"{name}={value!r}"
            for name, value in self.get_params().items()
            if value != self._defaults()[name]
        )
        return f"{type(self).__name__}({', '.join(other)})"

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "fitted_")

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import ClassifierTags, InputTags, Tags, TargetTags

        return Tags(
            estimator_type="classifier",
            target_tags=TargetTags(required=True),
            classifier_tags=ClassifierTags(
                poor_score=True
            ),  # a table of a few columns is no vibration
            input_tags=InputTags(three_d_array=True),
        )

    def _require_fitted(self) -> None:
        if not hasattr(self, "fitted_"):
            from sklearn.exceptions import NotFittedError

            raise NotFittedError(f"this {type(self).__name__} is not trained yet; call fit first.")
