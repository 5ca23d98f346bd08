"""Numbers, prefixes and folders that tell classes apart are kept in the proposed classes."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from swashtwin.recordings import class_name_findings, propose_index
from swashtwin.recordings.proposal import IndexProposal

CASES = Path(__file__).parent / "cases"


def propose_for(folder: Path, names: Sequence[str]) -> IndexProposal:
    """Return the proposal for files of these names, two of each class."""
    for number, name in enumerate(names):
        for part in (1, 2):
            path = folder / f"{name}_{part}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            samples = np.random.default_rng([number, part]).normal(size=60)
            path.write_text("acc\n" + "\n".join(f"{sample:.4f}" for sample in samples))
    return propose_index(folder, unit="g", sample_rate="1 kHz")


def write_with_header(folder: Path, *header: str) -> None:
    """Write two recordings of one class with the same header lines."""
    for number in range(2):
        samples = np.random.default_rng(number).normal(size=60)
        lines = [*header, "acc", *(f"{sample:.4f}" for sample in samples)]
        (folder / f"normal_{number}.csv").write_text("\n".join(lines), encoding="utf-8")


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (
            ["10 um/10 um_merged", "45 um/45 um_merged", "Healthy/Healthy_merged"],
            ["10 um", "45 um", "Healthy"],
        ),
        (["0.5X_B", "2.0X_B", "B", "normal"], ["0.5X_B", "2.0X_B", "B", "normal"]),
        (["0.5X_B/rec", "B/rec", "normal/rec"], ["0.5X_B", "B", "normal"]),
        (["normal", "wear_7mm", "wear_14mm"], ["normal", "wear_14mm", "wear_7mm"]),
        (["B007/run1", "IR014/run1", "normal/run1"], ["B007", "IR014", "normal"]),
        (["normal", "wear_7mil", "wear_14mil"], ["normal", "wear_14mil", "wear_7mil"]),
        (["normal", "wear_0.007inch", "wear_0.014inch"], ["normal", "wear_0.014inch"]),
        (["normal_0um", "wear_10um", "wear_45um"], ["normal", "wear_10um", "wear_45um"]),
        (["normal", "wear_50%", "wear_100%"], ["normal", "wear_50%", "wear_100%"]),
        (["normal data/10um/x", "normal data/45um/x", "normal data/0um/x"], ["10um", "45um"]),
        (["0 um/healthy", "10 um/rec", "45 um/rec"], ["healthy", "10 um", "45 um"]),
        (["Stufe0/gut", "Stufe1/x", "Stufe2/x", "leck/x"], ["gut", "Stufe1", "Stufe2", "leck"]),
        (["ok", "not_ok_10um", "not_ok_45um"], ["ok", "not_ok_10um", "not_ok_45um"]),
        (["normal/x", "wear level 1/x", "wear level 2/x"], ["normal", "wear level 1"]),
    ],
)
def test_what_tells_classes_apart_is_kept_and_said(
    tmp_path: Path, names: list[str], labels: list[str]
) -> None:
    proposal = propose_for(tmp_path, names)

    assert set(labels) <= set(proposal.index["classes"])
    assert len(proposal.index["classes"]) == len(names)
    (note,) = [note for note in proposal.notes if note.kind == "numbered_classes"]
    assert "or else machines, operating points or measurements" in note.message
    assert "{label_pattern}" in note.remedy


@pytest.mark.parametrize(
    "names",
    [
        ["A/10kHz_wear", "A/10kHz_normal", "B/normal_25Hz"],
        ["run1/wear", "run2/normal", "15MPa/normal"],
        ["wear_1", "wear_2", "normal_3"],
        ["3d_wear", "3d_normal"],
        ["2026-01-03/wear", "2026-01-04/normal"],
        ["normal_1a", "normal_1b", "wear_1a", "wear_1b"],
        ["normal_10sec", "normal_60sec", "wear_10sec", "wear_60sec"],
        ["normal_30lpm", "normal_60lpm", "wear_30lpm", "wear_60lpm"],
        ["normal_45cc", "normal_100cc", "wear_45cc", "wear_100cc"],
        ["normal_45ccm", "normal_100ccm", "wear_45ccm", "wear_100ccm"],
        ["normal_05Jan", "normal_06Jan", "wear_05Jan", "wear_06Jan"],
        ["normal_1st", "normal_2nd", "wear_1st", "wear_2nd"],
        ["normal_10Nm", "normal_20Nm", "wear_10Nm", "wear_20Nm"],
        ["2024-Jan-05/wear", "2024-Jan-06/normal", "normal/rec"],
        ["05 March/wear", "06 March/normal", "normal/rec"],
        ["Anlage3/wear", "Anlage4/normal", "normal/rec"],
        ["Halle3/wear", "Halle3/normal", "normal/rec"],
        ["Rig 2/wear", "wear/rec", "normal/rec"],
        ["Motor1/wear", "Motor2/normal", "normal/rec"],
        ["Werk 1/wear", "Werk 2/normal", "normal/rec"],
        ["P3/wear", "P12/normal", "normal/rec"],
        ["A/wear", "A/normal", "normal/rec", "B/wear"],
        ["normal_50%", "normal_100%", "wear_50%", "wear_100%"],
        ["KW05/wear", "2024_KW06/wear", "normal/rec"],
        ["20240105T103000/wear", "2024-01-06_10h30min/wear", "normal/rec"],
    ],
)
def test_machines_operating_points_and_counts_are_no_classes(
    tmp_path: Path, names: list[str]
) -> None:
    proposal = propose_for(tmp_path, names)

    assert set(proposal.index["classes"]) == {"wear", "normal"}
    assert not [note for note in proposal.notes if note.kind == "numbered_classes"]


@pytest.mark.parametrize(
    ("names", "listed"),
    [
        (["normal", "wear_45foo", "wear_100foo"], "100foo, 45foo"),
        (["normal_2mm", "normal_4mm", "wear_2mm", "wear_4mm"], "2mm, 4mm"),
    ],
)
def test_numbers_that_may_be_parts_of_classes_are_listed(
    tmp_path: Path, names: list[str], listed: str
) -> None:
    proposal = propose_for(tmp_path, names)

    assert set(proposal.index["classes"]) == {"wear", "normal"}
    (note,) = [note for note in proposal.notes if note.kind == "unused_numbers"]
    assert note.message == f"found in names, not used: {listed}."


@pytest.mark.parametrize(
    ("names", "machines"),
    [
        (["A/wear", "B/wear", "normal/rec"], "A, B"),
        (["P3/wear", "P12/wear", "normal/rec"], "P12, P3"),
        (["A/wear", "B/normal", "normal/rec"], None),
        (["A/wear", "A/normal", "B/wear", "B/normal"], None),
    ],
)
def test_codes_beside_classes_that_are_taken_for_machines_are_listed(
    tmp_path: Path, names: list[str], machines: str | None
) -> None:
    proposal = propose_for(tmp_path, names)

    messages = [note.message for note in proposal.notes if note.kind == "unclear_machines"]
    expected = f"the folders {machines} stand beside classes and were read as machines (specimen)."
    assert messages == ([] if machines is None else [expected])


def test_classes_that_differ_in_case_only_are_said() -> None:
    proposal = propose_index(CASES / "K23-case", unit="g")

    messages = [note.message for note in proposal.notes if note.kind == "similar_classes"]
    assert len(messages) == 2
    assert "'Fault' and 'fault' differ in case" in messages[0]


@pytest.mark.parametrize(
    ("first", "second", "are_similar"),
    [
        ("1.0mm", "10mm", False),
        ("-1 mm", "1 mm", False),
        ("0.1_mm", "01mm", False),
        ("wear <1mm", "wear >1mm", False),
        ("level 1 2", "level 12", False),
        ("wear_-5", "wear_5", False),
        ("1,5 mm", "1.5mm", True),
        ("wear-1", "Wear 1", True),
        ("\N{MINUS SIGN}1 mm", "-1mm", True),
        ("Valve-Plate", "valveplate", True),
        ("5X_B", "5x b", True),
    ],
)
def test_classes_of_other_sizes_are_not_similar(first: str, second: str, are_similar: bool) -> None:
    kinds = [finding.kind for finding in class_name_findings([first, second])]

    assert ("similar_classes" in kinds) is are_similar


def test_codes_in_names_that_may_be_machines_are_listed(tmp_path: Path) -> None:
    proposal = propose_for(tmp_path, ["P12_normal", "P14_normal", "P12_wear", "P14_wear"])

    (note,) = [note for note in proposal.notes if note.kind == "machine_codes"]
    assert note.message == "found in names, not used: P12, P14."
    assert proposal.index["classes"] == ["normal", "wear"]


@pytest.mark.parametrize("heading", ["Pruefling;P14", "Prüfling: P14", "Machine = P14", "DUT;P14"])
def test_the_machine_that_a_header_names_is_proposed(tmp_path: Path, heading: str) -> None:
    write_with_header(tmp_path, heading)

    proposal = propose_index(tmp_path, unit="g", sample_rate="1 kHz")

    assert proposal.index["defaults"]["specimen"] == "P14"
    assert "specimen: P14 (2), from the file" in proposal.facts


@pytest.mark.parametrize(
    "line",
    [
        "Serial number: 12345",
        "SN: 77",
        "Seriennummer;4711",
        "Machine: 1480 rpm",
        "Pump: Rexroth A10VSO",
        "Pumpe;Parker PV046",
        "Maschine: 15 kW",
        "DUT = 250 bar",
        "Pump name: A10VSO",
    ],
)
def test_a_logger_a_quantity_and_a_type_are_no_machine(tmp_path: Path, line: str) -> None:
    write_with_header(tmp_path, line)

    proposal = propose_index(tmp_path, unit="g", sample_rate="1 kHz")

    assert "specimen" not in proposal.index.get("defaults", {})
    assert all("specimen" not in entry for entry in proposal.index["recording"])
    (note,) = [note for note in proposal.notes if note.kind == "header_machines"]
    name, value = re.split("[:;=]", line)
    assert note.message == f"found in headers, not used: {name.strip()} = {value.strip()}."


@pytest.mark.parametrize(
    ("line", "machine"),
    [
        ("Pump serial number: 12345", "12345"),
        ("Maschinen-Nr.;4711", "4711"),
        ("Pumpennummer: 2023/117", "2023/117"),
        ("Machine SN: R902-44X", "R902-44X"),
        ("Pump ID: north", "north"),
        ("Pumpe: A", "A"),
        ("Machine: Pump 7", "Pump 7"),
        ("Aggregat: 3", "3"),
    ],
)
def test_a_number_of_the_pump_is_the_machine(tmp_path: Path, line: str, machine: str) -> None:
    write_with_header(tmp_path, "Serial number: 99", line)

    proposal = propose_index(tmp_path, unit="g", sample_rate="1 kHz")

    assert proposal.index["defaults"]["specimen"] == machine
    assert not [note for note in proposal.notes if note.kind == "header_machines"]


def test_properties_of_a_tdms_group_are_facts(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    group = nptdms.GroupObject("g", {"SpeedRPM": 1500.0, "PressureBar": 150.0, "Machine": "P7"})
    samples = np.random.default_rng(0).normal(size=500)
    properties = {"wf_increment": 1e-3, "unit_string": "g"}
    with nptdms.TdmsWriter(tmp_path / "normal.tdms") as writer:
        writer.write_segment([group, nptdms.ChannelObject("g", "acc", samples, properties)])

    (entry,) = propose_index(tmp_path).index["recording"]

    assert (entry["speed"], entry["pressure"]) == ("1500.0 rpm", "150.0 bar")
    assert entry["specimen"] == "P7"


@pytest.mark.parametrize(
    ("name", "pressure"), [("p_bar", "150 bar"), ("p_MPa", "150 MPa"), ("p", None)]
)
def test_a_symbol_is_a_pressure_only_with_its_unit(
    tmp_path: Path, name: str, pressure: str | None
) -> None:
    samples = np.random.default_rng(0).normal(size=500)
    savemat(tmp_path / "normal.mat", {"acc": samples, "fs": 1000.0, name: 150.0})

    (entry,) = propose_index(tmp_path, unit="g").index["recording"]

    assert entry.get("pressure") == pressure


def test_many_notes_of_one_kind_are_one(tmp_path: Path) -> None:
    for number in range(78):
        samples = np.random.default_rng(number).normal(size=20)
        lines = [f"Drehzahl: {1500 + number} rpm", "acc", *map("{:.4f}".format, samples)]
        (tmp_path / f"normal_1000rpm_{number}.csv").write_text("\n".join(lines))

    notes = propose_index(tmp_path, unit="g", sample_rate="1 kHz").notes

    (note,) = [note for note in notes if note.kind == "contradicted"]
    assert "(Similar: normal_1000rpm_1.csv, normal_1000rpm_10.csv, " in note.message
    assert note.message.endswith(" and 74 more.)")
