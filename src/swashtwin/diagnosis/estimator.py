"""What models of every kind share: scikit-learn's conventions."""

import inspect
from collections.abc import Mapping
from functools import cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, get_args, get_origin

from swashtwin.foundation import InputError

# Type that an annotation accepts, so that NumPy's numbers pass, and its description.
_ACCEPTED_TYPES = {
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    str: (str, "text"),
    bool: (bool, "True or False"),
    Mapping: (Mapping, "a mapping by name"),
    NoneType: (NoneType, "None"),
}


class Estimator:
    """Base of classes whose constructor only stores parameters, and which are trained by `fit`.

    It follows scikit-learn's conventions without importing scikit-learn. A trained estimator has
    the attribute ``fitted_``.
    """

    @classmethod
    @cache
    def _defaults(cls) -> dict[str, Any]:
        """Return the default of each parameter of the constructor."""
        parameters = inspect.signature(cls.__init__).parameters.values()
        return {
            parameter.name: parameter.default
            for parameter in parameters
            if parameter.name != "self"
        }

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the parameters of the constructor by name."""
        return {name: getattr(self, name) for name in self._defaults()}

    def changed_params(self) -> dict[str, Any]:
        """Return the parameters of the constructor that are not at their defaults, by name."""
        return {
            name: value
            for name, value in self.get_params().items()
            if value != self._defaults()[name]
        }

    def set_params(self, **parameters: Any) -> "Estimator":
        """Change parameters of the constructor and return the estimator."""
        for name, value in parameters.items():
            if name not in self._defaults():
                raise ValueError(
                    f"{type(self).__name__} has no parameter {name!r}; it has "
                    f"{', '.join(self._defaults())}."
                )
            setattr(self, name, value)
        return self

    def _require_parameters(self) -> None:
        """Raise an `InputError` if a parameter does not have a type of its annotation."""
        signature = inspect.signature(type(self).__init__)
        for name, value in self.get_params().items():
            annotation = signature.parameters[name].annotation
            is_union = isinstance(annotation, UnionType)
            options = get_args(annotation) if is_union else (annotation,)

            descriptions = []
            is_valid = False
            for option in options:
                option_type = get_origin(option) or option
                default = (option_type, f"a {getattr(option_type, '__name__', option_type)}")
                accepted_type, description = _ACCEPTED_TYPES.get(option_type, default)
                descriptions.append(description)

                # True is an instance of Integral, but a slip if a number is expected.
                is_slip = value is True and accepted_type is not bool
                is_valid |= isinstance(value, accepted_type) and not is_slip

            if not is_valid:
                raise InputError(
                    f"{name} ({value!r}) must be {' or '.join(descriptions)}.", field=name
                )

    def __repr__(self) -> str:
        changes = (f"{name}={value!r}" for name, value in self.changed_params().items())
        return f"{type(self).__name__}({', '.join(changes)})"

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "fitted_")

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import ClassifierTags, InputTags, Tags, TargetTags

        return Tags(
            estimator_type="classifier",
            target_tags=TargetTags(required=True),
            # scikit-learn's checks score on tables of a few columns, which are not vibration.
            classifier_tags=ClassifierTags(poor_score=True),
            input_tags=InputTags(three_d_array=True),
        )

    def _require_fitted(self) -> None:
        if not hasattr(self, "fitted_"):
            from sklearn.exceptions import NotFittedError

            raise NotFittedError(f"This {type(self).__name__} is not trained yet; call fit first.")
