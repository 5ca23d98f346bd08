"""`write_study_report`: studies in, one page and its data out."""

from collections import Counter
from pathlib import Path

from swashtwin.report import Part, write_report
from swashtwin_bench.results.result import StudyResult
from swashtwin_bench.results.study_part import study_part
from swashtwin_bench.results.table import StudyTable
from swashtwin_bench.results.table_part import table_part


def write_study_report(*studies: StudyTable, folder: Path | str) -> Path:
    """Path of ``report.html`` with one part for each study; see `write_report`.

    Parameters
    ----------
    studies : in the order wanted. Figures of several are named by their study.
    folder : made if it does not exist.

    Raises
    ------
    InputError
        No study, or `folder` is a file.
    """
    names = [study.study.replace("-", "_") if len(studies) > 1 else "study" for study in studies]
    total, number = Counter(names), Counter[str]()
    parts = []
    for name, study in zip(names, studies, strict=True):
        number[name] += 1
        parts.append(_part(study, f"{name}_{number[name]}" if total[name] > 1 else name))
    return write_report(*parts, folder=folder)


def _part(study: StudyTable, key: str) -> Part:
    return study_part(study, key) if isinstance(study, StudyResult) else table_part(study, key)
