"""Errors state a remedy whose settings are spelled for whoever reads it."""

import pickle

import pytest

from swashtwin.foundation import (
    DataError,
    InputError,
    render_settings,
    spell_for_index,
)


def unitless_file() -> DataError:
    return DataError("a.csv specifies no unit.", field="unit", remedy="Set {unit='g'}.")


def test_an_error_reads_as_python_unless_another_spelling_is_asked_for() -> None:
    error = unitless_file()

    assert str(error) == "a.csv specifies no unit. Set unit='g'."
    assert error.describe(spell_for_index) == 'a.csv specifies no unit. Set unit = "g".'


def test_an_error_keeps_its_remedy_through_a_pickle_and_a_prefix() -> None:
    error = pickle.loads(pickle.dumps(unitless_file()))
    assert str(error) == str(unitless_file())

    prefixed = error.with_context("folder: ")
    assert type(prefixed) is DataError
    assert str(prefixed) == "folder: a.csv specifies no unit. Set unit='g'."
    assert prefixed.field == "unit"


@pytest.mark.parametrize(
    ("text", "rendered"),
    [
        ("Set {unit='g'}, or {unit='m/s2'}.", "Set unit='g', or unit='m/s2'."),
        ("Leave out {sample_rate}.", "Leave out sample_rate."),
        ("{{unit}} stays.", "{unit} stays."),
        ("nothing to set", "nothing to set"),
    ],
)
def test_settings_in_braces_are_spelled_out(text: str, rendered: str) -> None:
    assert render_settings(text) == rendered


def test_an_error_without_a_remedy_is_its_message() -> None:
    assert str(InputError("depth {3} is negative.")) == "depth {3} is negative."
