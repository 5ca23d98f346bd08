"""Short texts and tables of results."""

from dataclasses import dataclass

import numpy as np

from swashtwin import Twin, load_pump
from swashtwin.foundation import html_table, short_repr
from swashtwin.pump import OperatingCondition


@dataclass
class Result:
    name: str
    values: np.ndarray
    notes: tuple[str, ...]

    __repr__ = short_repr


def test_a_short_text_has_the_shapes_of_arrays_and_the_counts_of_long_lists() -> None:
    result = Result("a", np.zeros((2, 5000)), 100 * ("note",))
    assert repr(result) == "Result(name='a', values=array(2, 5000), notes=<100 items>)"


def test_a_pump_and_its_twin_have_a_short_text(at_15: OperatingCondition) -> None:
    pump = load_pump("25scy14-1b")
    twin = Twin(pump, at_15)
    assert repr(twin) == "<Twin of 25scy14-1b (normal) at 860 rpm, 15 MPa>"
    assert len(repr(pump)) < 120


def test_a_table_escapes_its_texts_and_counts_the_rows_that_it_leaves_out() -> None:
    rows = [("<script>", None)] * 15
    html = html_table("<a <b>>", ("name", "\x1b"), rows, "", "a & b")

    assert "<script>" not in html
    assert html.count("&lt;script&gt;") == 12
    assert "<strong>a &lt;b</strong>" in html
    assert "\x1b" not in html
    assert "<p>3 more rows.</p><p>a &amp; b</p>" in html
