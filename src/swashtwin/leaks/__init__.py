"""What lets a test know its answer: copies, classes that something else gives away, and roles that overlap."""

from swashtwin.leaks.audit import Audit, AuditFinding, audit
from swashtwin.leaks.confounding import Confounding, confounding
from swashtwin.leaks.copies import Copy, Place, copied_recordings, copied_windows
from swashtwin.leaks.table import AuditRow, read_audit_rows, rows_of

__all__ = [
    "Audit",
    "AuditFinding",
    "AuditRow",
    "Confounding",
    "Copy",
    "Place",
    "audit",
    "confounding",
    "copied_recordings",
    "copied_windows",
    "read_audit_rows",
    "rows_of",
]
