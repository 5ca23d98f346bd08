"""Text tables as users of other readers have reported them are read right, or refused by name.

Unless a case says otherwise, a file holds `NOISE` in g at 10 kHz. A comment that begins with
``owner/project`` names the public thread that reported such a file.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reported_cases import (
    COUNTS,
    IS_MISSING,
    N_SAMPLES,
    NOISE,
    NOISE_WITH_GAPS,
    RATE,
    READ_CASE,
    REFUSED_CASE,
    TIME,
    TIME_TEXTS,
    VOLTS,
    FileWriter,
    G,
    assert_reads,
    assert_refuses,
    reads,
    refuses,
)

# ---- text tables


def text_file(name: str, *lines: str) -> FileWriter:
    def write(folder: Path) -> Path:
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
        return folder / name

    return write


def rows(separator: str, *columns: Iterable[Any], end: str = "") -> list[str]:
    """Return the rows of a table, each with `end` behind its last field."""
    return [separator.join(map(str, row)) + end for row in zip(*columns, strict=True)]


def csv_file(
    *head: str,
    columns: Iterable[Iterable[Any]] = (TIME_TEXTS, NOISE),
    separator: str = ",",
    end: str = "",
) -> FileWriter:
    """Return a writer of a table below the lines of `head`, by default of times and noise."""
    return text_file("a.csv", *head, *rows(separator, *columns, end=end))


def with_decimal_commas(values: Iterable[Any]) -> list[str]:
    return [str(value).replace(".", ",") for value in values]


@pytest.mark.parametrize(
    READ_CASE,
    [
        # MilesMcBain/datapasta/issues/27
        reads("separator at the end of each row", csv_file("t [s],x [g]", end=",")),
        # mccdaq/daqhats/issues/15
        reads(
            "decimal commas between blanks",
            text_file(
                "a.txt", *rows("   ", with_decimal_commas(TIME_TEXTS), with_decimal_commas(NOISE))
            ),
            unit="g",
        ),
        # numpy.savetxt writes headings behind the mark of a comment.
        reads(
            "headings of numpy",
            text_file("a.dat", "# t [s] x [g]", *rows(" ", TIME_TEXTS, NOISE)),
        ),
        reads(
            "line of types below the units",
            csv_file("t;x", "s;g", "float;float", separator=";"),
        ),
        reads(
            "headings with an index",
            csv_file("t [s],Y[0],Y[1]", columns=(TIME_TEXTS, NOISE, NOISE)),
            unit="g",
            channels=["Y[1]"],
        ),
        reads("parentheses in a unit", csv_file("t,x", "s,m/(s^2)"), NOISE / G),
        reads("unit behind the word in", csv_file("Time in seconds,x in m/s\u00b2"), NOISE / G),
        reads(
            "N/A for a missing sample",
            csv_file(
                "t [s],x [g]", columns=(TIME_TEXTS, np.where(IS_MISSING, "N/A", NOISE.astype(str)))
            ),
            NOISE_WITH_GAPS,
        ),
        # The C library of Windows writes NaN so.
        reads(
            "1.#QNAN for a missing sample",
            csv_file(
                "t [s],x [g]",
                columns=(TIME_TEXTS, np.where(IS_MISSING, "1.#QNAN", NOISE.astype(str))),
            ),
            NOISE_WITH_GAPS,
        ),
        reads(
            "sign of infinity for an overflow",
            csv_file("t [s],x [g]", columns=(TIME_TEXTS, ["\u221e", *NOISE[1:]])),
            np.array([np.inf, *NOISE[1:]]),
        ),
        # Only the last two rows have the exponents of Fortran: the first rows do not show them.
        reads(
            "exponents with D at the end",
            csv_file(
                "t [s],x [g]",
                columns=(
                    TIME_TEXTS,
                    [*NOISE[:399], *(f"{x:.6e}".replace("e", "D") for x in NOISE[399:])],
                ),
            ),
        ),
        reads(
            "typographic minus",
            csv_file(
                "t [s],x [g]", columns=(TIME_TEXTS, [str(x).replace("-", "\u2212") for x in NOISE])
            ),
        ),
    ],
)
def test_a_table_is_read_however_its_numbers_and_headings_are_written(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


@pytest.mark.parametrize(
    REFUSED_CASE,
    [
        # pola-rs/polars/issues/10585: the further field is not dropped.
        refuses(
            "row with a further field",
            text_file("a.csv", "t [s],x [g]", *rows(",", TIME_TEXTS, NOISE), "0.0401,1,2"),
            "line 403 has 3 columns, not 2",
        ),
        refuses(
            "more headings than columns",
            csv_file("t [s],x [g],y [g],z [g]", columns=(TIME_TEXTS, NOISE, NOISE)),
            "line 1 has 4 headings for 3 columns",
        ),
        # pola-rs/polars/issues/18797
        refuses(
            "marks for thousands",
            csv_file(
                "t;x", columns=(with_decimal_commas(TIME_TEXTS), ["1.299,99"] * 401), separator=";"
            ),
            "marks for thousands",
        ),
    ],
)
def test_a_table_whose_numbers_are_ambiguous_is_refused(
    write: FileWriter, options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    assert_refuses(write(tmp_path), options, message)


# ---- time columns of tables

EPOCH_TEXTS = [f"{1774430000 + value:.4f}" for value in TIME]

# Days since 1899-12-30, as a spreadsheet counts them: 2026-03-02.
SPREADSHEET_DAY = 46083

TICKS = range(0, 100 * N_SAMPLES, 100)
TICK_FILE = csv_file("tick,x [g]", columns=(TICKS, NOISE))
ANGLE_FILE = csv_file("angle,x [g]", columns=(36 * TIME, NOISE))
TWO_RATES_FILE = csv_file("Sample rate: 20000", "t [s],x [g]")


@pytest.mark.parametrize(
    READ_CASE,
    [
        reads("hours", csv_file("time (h),x [g]", columns=(TIME / 3600, NOISE))),
        reads(
            "days of a spreadsheet",
            csv_file("t,x [g]", columns=(SPREADSHEET_DAY + TIME / 86400, NOISE)),
        ),
        reads("seconds since 1970", csv_file("c0,x [g]", columns=(EPOCH_TEXTS, NOISE))),
        # PostgreSQL writes the offset of a time zone in hours alone.
        reads(
            "time zone in hours",
            csv_file(
                "t,x [g]",
                columns=([f"2026-03-02 09:00:00.{n:04d}+02" for n in range(N_SAMPLES)], NOISE),
            ),
        ),
        reads("ticks of a stated unit", TICK_FILE, time_unit="us"),
        reads(
            "one column for each channel",
            csv_file("t1 [s],x [g],t2 [s],y [g]", columns=(TIME_TEXTS, NOISE, TIME_TEXTS, NOISE)),
            channels=["x"],
        ),
        reads(
            "beside a time that stands still",
            csv_file("timestamp,t [s],x [g]", columns=([EPOCH_TEXTS[0]] * 401, TIME_TEXTS, NOISE)),
        ),
        # A counter of one byte begins again after 255.
        reads(
            "beside a counter that begins again",
            csv_file("n,t [s],x [g]", columns=(np.arange(N_SAMPLES) % 256, TIME_TEXTS, NOISE)),
        ),
        reads("one of two rates, by its column", TWO_RATES_FILE, time_column="t"),
        reads("an angle with a rate", ANGLE_FILE, sample_rate=RATE),
    ],
)
def test_the_time_column_of_a_table_gives_the_rate(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


@pytest.mark.parametrize(
    REFUSED_CASE,
    [
        # Ticks of 100 would be seconds, which no recorder of vibration counts.
        refuses("ticks of an unknown unit", TICK_FILE, "would be 0.01 Hz"),
        # Every fourth sample is lost, or the times are rounded: both give the same numbers.
        refuses(
            "lost samples or rounded times",
            csv_file(
                "t [s],x [g]",
                columns=[np.delete(column, range(3, 401, 4)) for column in (TIME_TEXTS, NOISE)],
            ),
            "too coarse to tell 10000 Hz",
        ),
        refuses("header and column contradict", TWO_RATES_FILE, "two sample rates for x"),
        refuses("angle", ANGLE_FILE, "does not state its sample rate"),
    ],
)
def test_a_table_whose_time_column_leaves_the_rate_open_is_refused(
    write: FileWriter, options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    assert_refuses(write(tmp_path), options, message)


# Loggers of several sensors write a row for each, with its name, and so mix their samples.
@pytest.mark.parametrize(
    ("write", "n_sensors"),
    [
        pytest.param(
            csv_file(
                "t,x,sensor",
                columns=(
                    TIME_TEXTS,
                    NOISE,
                    ["ACC" if number % 3 else "GYR" for number in range(N_SAMPLES)],
                ),
            ),
            2,
            id="names in the last column",
        ),
        pytest.param(
            csv_file(columns=(np.arange(N_SAMPLES) % 3, TIME_TEXTS, NOISE)),
            3,
            id="numbers in the first column",
        ),
        pytest.param(
            csv_file("t,sensor,x", columns=(TIME_TEXTS, COUNTS % 8 == 0, NOISE)),
            2,
            id="a second sensor now and then",
        ),
    ],
)
def test_a_table_whose_rows_are_of_several_sensors_is_refused(
    write: FileWriter, n_sensors: int, tmp_path: Path
) -> None:
    assert_refuses(write(tmp_path), {}, f"{n_sensors} sensors by turns")


# ---- headers of tables


@pytest.mark.parametrize(
    "line",
    [
        "Sample rate: 10 kS/s",
        "Samples per second: 10000",
        "ODR: 10000 Hz",
        '"Sampling Rate","10000","Hz"',
        "fs = 10000 # Hz",
        "Acquisition rate: 10000 samples/second",
        "\u0394T: 1e-4 s",
    ],
)
def test_a_header_states_the_rate_in_its_own_words(line: str, tmp_path: Path) -> None:
    path = csv_file(line, "Unit: g", "x", columns=[NOISE])(tmp_path)

    assert_reads(path, {}, NOISE)


@pytest.mark.parametrize(
    "write",
    [
        # "10,000" is ten thousand, or ten with a decimal comma.
        pytest.param(
            text_file("a.txt", "Sample rate: 10,000 Hz", "Unit: g", "", *rows(" ", NOISE, NOISE)),
            id="comma in the number",
        ),
        pytest.param(
            csv_file("Frequency: 50 Hz", "Unit: g", "x", columns=[NOISE]),
            id="frequency of the mains",
        ),
    ],
)
def test_a_number_in_a_header_that_may_be_something_else_is_no_rate(
    write: FileWriter, tmp_path: Path
) -> None:
    assert_refuses(write(tmp_path), {}, "does not state its sample rate")


@pytest.mark.parametrize(
    READ_CASE,
    [
        reads(
            "preamble of an oscilloscope",
            csv_file(
                "Record Length,401,Points",
                "Sample Interval,1.0E-04,s",
                "Vertical Units,V",
                "Sensitivity (mV/g):,100",
                "n,x",
                columns=(range(N_SAMPLES), VOLTS),
            ),
        ),
        # Rigol's oscilloscopes state start and increment as two more headings.
        reads(
            "start and increment among the headings",
            csv_file(
                "X,CH1,Start,Increment,",
                "Sequence,Volt,0.0,1.0e-04",
                columns=(range(N_SAMPLES), NOISE),
                end=",",
            ),
            unit="g",
        ),
        reads(
            "sensitivity of each channel",
            csv_file(
                "Channel,x,y",
                "Sensitivity,100 mV/g,50 mV/g",
                "Unit,V,V",
                "t [s],x,y",
                columns=(TIME_TEXTS, VOLTS, VOLTS),
            ),
            2 * NOISE,
            channels=["y"],
        ),
        reads(
            "one unit for two sensitivities",
            csv_file(
                "Sensitivity: 100, 10.2 mV/g",
                "t [s],x [V],y [V]",
                columns=(TIME_TEXTS, VOLTS, VOLTS),
            ),
            channels=["x"],
        ),
    ],
)
def test_the_header_of_a_table_gives_rate_unit_and_sensitivity(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


def test_a_sensitivity_applies_only_to_samples_in_volts(tmp_path: Path) -> None:
    path = csv_file("Sensitivity: 100 mV/g", "t [s],x", columns=(TIME_TEXTS, VOLTS))(tmp_path)

    assert_refuses(path, {}, "unit='V' or unit='mV'")
    assert_reads(path, {"unit": "V"}, NOISE)

    # in g, the sensitivity has been applied
    assert_reads(path, {"unit": "g"}, VOLTS)


# ---- LVM, the tables of LabVIEW

# The note contains "X values", which is no heading.
LVM_HEAD = """\
LabVIEW Measurement
Separator{separator}{separator_name}
Decimal_Separator{separator}.
X_Columns{separator}One
***End_of_Header***

Notes{separator}X values guaranteed valid only for acc_x
Channels{separator}1
Samples{separator}401
Date{separator}2016/08/11
Time{separator}15:37:48.375
Y_Unit_Label{separator}g
X_Dimension{separator}Time
X0{separator}0.0
Delta_X{separator}1.0E-4
***End_of_Header***
X_Value{separator}x{separator}Comment"""


def lvm_file(lines: list[str], *, separator: str = "\t", separator_name: str = "Tab") -> FileWriter:
    head = LVM_HEAD.format(separator=separator, separator_name=separator_name)
    return text_file("a.lvm", *head.split("\n"), *lines)


# Each row ends with the separator of an empty comment.
LVM_ROWS = rows("\t", TIME_TEXTS, NOISE, end="\t")


@pytest.mark.parametrize(
    READ_CASE,
    [
        # ladisk/lvm_read/issues/5
        reads("tabs", lvm_file(LVM_ROWS)),
        # ladisk/lvm_read/pull/15
        reads(
            "commas",
            lvm_file(rows(",", TIME_TEXTS, NOISE, end=","), separator=",", separator_name="Comma"),
        ),
        reads("rows without a comment", lvm_file(rows("\t", TIME_TEXTS, NOISE))),
        reads("rows without a time", lvm_file([f"\t{x}\t" for x in NOISE])),
    ],
)
def test_a_table_of_labview_is_read_by_its_header(
    write: FileWriter, options: dict[str, Any], expected: np.ndarray, tmp_path: Path
) -> None:
    assert_reads(write(tmp_path), options, expected)


# ladisk/lvm_read/pull/10: a second measurement stands below the first.
def test_measurements_appended_to_a_table_of_labview_are_separate_channels(
    tmp_path: Path,
) -> None:
    path = lvm_file([*LVM_ROWS, *LVM_ROWS])(tmp_path)

    assert_refuses(path, {}, r"x \[2\]: sample 401 of the file")
    assert_reads(path, {"channels": ["x [2]"]}, NOISE)
