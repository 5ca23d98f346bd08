"""What overlaps between the roles of a split, whoever made it."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

from swashtwin.foundation import InputError
from swashtwin.learning.leakage.table import AuditRow

Severity = Literal["leak", "warning", "note"]
_SHOWN = 3


@dataclass(frozen=True)
class AuditFinding:
    """One thing that a reader of the scores must know."""

    kind: str
    """Short name, such as ``"shared_recording"``."""
    severity: Severity
    """``leak``: the test has, or could have, seen its answer; ``warning``: it shows less than it seems; ``note``."""
    roles: tuple[str, ...]
    """Roles that it concerns."""
    examples: tuple[str, ...]
    """The first few names that it concerns."""
    count: int
    """How many names."""
    windows: int
    """How many rows, of the role named last."""
    message: str
    """What was found and what to do."""


@dataclass(frozen=True)
class Audit:
    """What a table of windows says of the test that it is to serve."""

    roles: Mapping[str, int]
    """Rows of each role."""
    facts: tuple[str, ...]
    """Facts that the table has of a window; nothing else was checked."""
    findings: tuple[AuditFinding, ...]
    """What was found, leaks first."""

    @property
    def has_leak(self) -> bool:
        """Whether a leak was found."""
        return any(finding.severity == "leak" for finding in self.findings)


def audit(rows: Sequence[AuditRow], *, whole: Sequence[str] = ("recording",)) -> Audit:
    """What overlaps between the roles of `rows`.

    Parameters
    ----------
    whole : what must not be on two sides: ``"recording"``, ``"specimen"``, or names of the rows' ``groups``. An overlap
        of these is a leak, of others a warning.

    Raises
    ------
    InputError
        `whole` names what no row tells.

    Examples
    --------
    >>> rows = [AuditRow("a", "train", start=0, stop=100), AuditRow("a", "test", start=50, stop=150)]
    >>> [(finding.kind, finding.severity) for finding in audit(rows).findings]
    [('overlap', 'leak'), ('shared_recording', 'leak')]
    """
    facts = _facts(rows)
    for name in whole:
        if name not in facts:
            raise InputError(f"the table does not tell the {name} of any window, so nothing can be said of it.")
    roles: dict[str, list[AuditRow]] = defaultdict(list)
    for row in rows:
        roles[row.role].append(row)
    findings: list[AuditFinding] = []
    if len(roles) < 2:
        message = f"every row has the role {rows[0].role!r}: there is no second side to overlap with."
        findings.append(AuditFinding("one_role", "warning", (rows[0].role,), (), 0, len(rows), message))
    for first, second in combinations(roles, 2):
        findings += _between(first, roles[first], second, roles[second], whole, facts)
    for role, members in roles.items():
        findings += _within(role, members)
    findings += [*_classes(roles), *_one_specimen(rows)]
    order = {"leak": 0, "warning": 1, "note": 2}
    counts = {role: len(members) for role, members in roles.items()}
    return Audit(counts, facts, tuple(sorted(findings, key=lambda finding: order[finding.severity])))


def _facts(rows: Sequence[AuditRow]) -> tuple[str, ...]:
    """Facts that at least one row has."""
    names = ("recording", "window", "specimen", "channel", "start", "stop", "label", "sha256")
    present = [name for name in names if any(getattr(row, name) not in ("", None) for row in rows)]
    return (*present, *dict.fromkeys(name for row in rows for name in row.groups))


def _between(
    first: str,
    first_rows: Sequence[AuditRow],
    second: str,
    second_rows: Sequence[AuditRow],
    whole: Sequence[str],
    facts: Sequence[str],
) -> Iterable[AuditFinding]:
    """What two roles share."""
    roles = (first, second)
    overlap = _overlapping(first_rows, second_rows)
    if overlap:
        message = "windows of both roles cover the same moments of a recording; split first, cut windows afterwards"
        yield _finding("overlap", "leak", roles, [row.recording for row in overlap], len(overlap), message)
    for kind, key, message in (
        ("duplicate", lambda row: row.sha256, "the same samples (by hash) are in both roles; keep one copy"),
        ("shared_window", lambda row: row.window, "the same windows stand in both roles; each needs one role"),
    ):
        names, count = _shared(first_rows, second_rows, key)
        if names:
            yield _finding(kind, "leak", roles, names, count, message)
    groups = [name for name in facts if any(name in row.groups for row in first_rows)]
    parts: list[str] = ["recording", "specimen", *groups]
    for part in parts:
        names, count = _shared(first_rows, second_rows, _key(part))
        if names:
            severity: Severity = "leak" if part in whole else "warning"
            yield _finding(f"shared_{part}", severity, roles, names, count, _ADVICE.get(part, _ADVICE[""]).format(part))


_ADVICE = {
    "recording": "both roles hold windows of the same recordings, which are nearly equal; split by recording",
    "specimen": "both roles hold the same machines: the score says nothing of a machine that was never seen (level L2, "
    "not L4); split by specimen before claiming that",
    "": "both roles hold the same {0}: the score says nothing of one that was never seen; split by {0} before claiming "
    "that",
}


def _key(part: str) -> Callable[[AuditRow], str]:
    if part in ("recording", "specimen"):
        return lambda row: str(getattr(row, part))
    return lambda row: row.groups.get(part, "")


def _within(role: str, rows: Sequence[AuditRow]) -> Iterable[AuditFinding]:
    """What a role holds twice, or must not hold."""
    hashes = [row.sha256 for row in rows if row.sha256]
    twice = len(hashes) - len(set(hashes))
    if twice:
        message = "samples are in this role more than once (by hash); each copy counts again"
        yield _finding("duplicate_within", "note", (role,), [], twice, message)
    synthetic = [row.recording for row in rows if row.synthetic]
    if synthetic and role != "train":
        message = "synthetic windows must not be tested on, nor chosen by; keep them in train"
        severity: Severity = "leak" if role in ("test", "validation") else "warning"
        yield _finding("synthetic", severity, (role,), synthetic, len(synthetic), message)
    if role == "test":
        crowded = _overlapping(rows, None)
        if crowded:
            message = (
                "windows of the test overlap each other: one moment counts more than once, intervals come out short"
            )
            yield _finding(
                "test_overlap", "warning", (role,), [row.recording for row in crowded], len(crowded), message
            )


def _classes(roles: Mapping[str, Sequence[AuditRow]]) -> Iterable[AuditFinding]:
    """Classes that stand in one role only."""
    seen = {role: {row.label for row in rows if row.label} for role, rows in roles.items()}
    for name in sorted(set().union(*seen.values())):
        holders = [role for role in seen if name in seen[role]]
        if len(holders) == 1 and len(roles) > 1:
            count = sum(row.label == name for row in roles[holders[0]])
            message = "this class stands in one role only: it is either never learned or never tested"
            yield _finding("class_in_one_role", "warning", (holders[0],), [name], count, message)


def _one_specimen(rows: Sequence[AuditRow]) -> Iterable[AuditFinding]:
    """Classes that one machine alone has."""
    machines: dict[str, set[str]] = defaultdict(set)
    for row in rows:
        if row.label and row.specimen:
            machines[row.label].add(row.specimen)
    alone = sorted(name for name, seen in machines.items() if len(seen) == 1)
    if alone and len(machines) > 1:
        count = sum(row.label in alone for row in rows)
        message = "these classes were measured on one machine each: whatever is special about it tells the class"
        yield _finding("one_specimen_class", "warning", (), alone, count, message)


def _shared(
    first_rows: Sequence[AuditRow], second_rows: Sequence[AuditRow], key: Callable[[AuditRow], str]
) -> tuple[list[str], int]:
    """Names that both have, and how many of `second_rows` carry them."""
    names = sorted(({key(row) for row in first_rows} & {key(row) for row in second_rows}) - {""})
    shared = set(names)
    return names, sum(key(row) in shared for row in second_rows)


def _overlapping(rows: Sequence[AuditRow], other_rows: Sequence[AuditRow] | None) -> list[AuditRow]:
    """Rows of `other_rows` that cover a moment of one of `rows`, or of the rows before where there are no others.

    Channels are not told apart: two sensors at one moment saw the same event. Rows of one moment that differ in nothing
    but the channel are one window.
    """
    overlaps = []
    sides = [(row, 0) for row in rows] + [(row, 1) for row in other_rows or ()]
    spans: dict[str, list[tuple[float, float, int, AuditRow]]] = defaultdict(list)
    for row, side in sides:
        if row.start is not None and row.stop is not None:
            spans[row.recording].append((row.start, row.stop, side, row))
    for members in spans.values():
        members.sort(key=lambda span: span[:3])
        if other_rows is None:
            distinct = sorted({(start, stop): row for start, stop, _, row in members}.items(), key=lambda span: span[0])
            last = float("-inf")
            for (start, stop), row in distinct:
                overlaps += [row] if start < last else []
                last = max(last, stop)
        else:
            overlaps += _covered(members)
    return overlaps


def _covered(members: Sequence[tuple[float, float, int, AuditRow]]) -> list[AuditRow]:
    """Rows of side 1 that overlap one of side 0, of spans sorted by start."""
    ahead: list[tuple[float, AuditRow]] = []
    last, overlaps = float("-inf"), dict[int, AuditRow]()
    for start, stop, side, row in members:
        if side == 0:
            last = max(last, stop)
            overlaps |= {id(earlier): earlier for end, earlier in ahead if end > start}
            ahead = [(end, earlier) for end, earlier in ahead if end > start and id(earlier) not in overlaps]
        else:
            if start < last:
                overlaps[id(row)] = row
            else:
                ahead.append((stop, row))
    return list(overlaps.values())


def _finding(
    kind: str, severity: Severity, roles: tuple[str, ...], names: Sequence[str], windows: int, message: str
) -> AuditFinding:
    distinct = list(dict.fromkeys(names))
    shown = ", ".join(distinct[:_SHOWN]) + (f" and {len(distinct) - _SHOWN} more" if len(distinct) > _SHOWN else "")
    between = " and ".join(roles)
    text = f"{between}: {message}" if between else message
    row = "row" if windows == 1 else "rows"
    of = f" of {roles[-1]}" if roles else ""
    text += f" ({shown + '; ' if shown else ''}{windows} {row}{of})."
    return AuditFinding(kind, severity, roles, tuple(distinct[:_SHOWN]), len(distinct), windows, text)
