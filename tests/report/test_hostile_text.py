"""Control characters in names make no page or figure ill-formed."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from swashtwin.diagnosis import Diagnosis
from swashtwin.report import write_report

HOSTILE = "a\x00\x1b]0;x\x07\x9b\u202e\ud800\uffff\nb"


def test_a_report_of_hostile_names_is_well_formed(tmp_path: Path) -> None:
    diagnosis = Diagnosis(
        recording_id=HOSTILE,
        label=HOSTILE,
        probabilities={"normal": 0.1, HOSTILE: 0.9},
        window_labels=(HOSTILE, "normal"),
        notes=(HOSTILE,),
    )
    page = write_report(diagnosis, folder=tmp_path).read_text(encoding="utf-8")
    figures = sorted((tmp_path / "figures").glob("*.svg"))
    assert figures
    for figure in figures:
        ElementTree.fromstring(figure.read_bytes())
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\ufffe\uffff]", page)
    assert r"a\x00\x1b]0;x\x07" in page
