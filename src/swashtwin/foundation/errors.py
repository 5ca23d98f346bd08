"""Everything swashtwin raises on purpose.

Each error is a `SwashTwinError` and also the builtin error a caller would expect, so ``except
ValueError`` still works. A message says what is wrong with which value, what would be right, and
the likely slip; it is one line, so that the command line can print it as it is.
"""


class SwashTwinError(Exception):
    """Base of every error that swashtwin raises on purpose.

    Parameters
    ----------
    field : name of the argument that a caller should change, where the message does not say it; the
        command line shows its option.
    """

    def __init__(self, message: str = "", *, field: str = "") -> None:
        super().__init__(message)
        self.field = field


class InputError(SwashTwinError, ValueError):
    """A value that a caller gave is outside what it can be."""


class UnitError(InputError):
    """A quantity has no unit, or one of another dimension."""


class DataError(SwashTwinError, ValueError):
    """A file or a recording is damaged, incomplete, or contradicts what was said of it."""


class MissingFileError(DataError, FileNotFoundError):
    """A file that was named does not exist."""


class LeakError(SwashTwinError, ValueError):
    """A split or an evaluation would let test data be seen in training."""


class StabilityError(SwashTwinError, ValueError):
    """An integration step lies above the stability limit."""


class ArtifactError(DataError):
    """A saved model or result was changed, damaged, or written by another version."""


class MissingExtraError(SwashTwinError, ImportError):
    """An optional dependency is needed for what was asked."""
