"""What a file is by its first bytes, to name one whose suffix states something else."""

import codecs
import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from swashtwin.foundation import DataError

# Bytes at the beginning by which a file is recognized.
_HEAD_BYTES = 1024

# Characters of a text that a message repeats.
_MAX_QUOTE_LENGTH = 40

_SAVE_AS_CSV = "Save its sheet as CSV."
_UNPACK = "Unpack it, and name the file in it."
_RENAME_TEXT = "Rename it to .csv if it is a table."


@dataclass(frozen=True)
class _Signature:
    """Beginning of a kind of file."""

    pattern: bytes
    """Regular expression that matches at the beginning."""
    kind: str
    """What the file is, such as ``"a PDF document"``."""
    remedy: str
    modules: tuple[str, ...] = ()
    """Modules of this package that read the file."""


def _own_format(pattern: bytes, kind: str, suffix: str, *modules: str) -> _Signature:
    return _Signature(pattern, kind, f"Rename it to {suffix}.", modules)


_SIGNATURES = (
    _Signature(
        rb"version https://git-lfs\.github\.com",
        "a Git LFS pointer to the file",
        "Fetch the file itself with 'git lfs pull'.",
    ),
    _Signature(
        rb"(?:\.\./)*(?:\.git)?/annex/objects/",
        "a git-annex pointer to the file",
        "Fetch the file itself with 'git annex get'.",
    ),
    _Signature(
        rb"(?i:\s*(?:<!--.*?-->\s*)?<(?:!doctype html|html|head|body)\b)",
        "a web page (HTML)",
        "Download the file itself: the page may be a login, or an error.",
    ),
    _Signature(rb"%PDF-", "a PDF document", "Export the samples as CSV."),
    _Signature(
        rb'\s*(?:\{\s*"|\[\s*[\[{]|\[\s*-?\d[\d.eE+-]*\s*,)',
        "a JSON text",
        "Write its samples as CSV.",
    ),
    _Signature(
        rb"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "a workbook or document of Office", _SAVE_AS_CSV
    ),
    _Signature(rb"BZh[1-9]1AY|\xfd7zXZ\0|\x28\xb5\x2f\xfd", "a packed file", _UNPACK),
    _Signature(rb"7z\xbc\xaf\x27\x1c|Rar!\x1a\x07", "an archive", _UNPACK),
    _Signature(rb"SQLite format 3\0", "an SQLite database", "Export its samples as CSV."),
    _Signature(rb"\x89PNG\r\n|\xff\xd8\xff|GIF8|BM....\0\0\0\0", "an image", "Name a recording."),
    _Signature(rb"\x93NUMPY", "a single NumPy array", "Write it with numpy.savez as .npz."),
    _Signature(rb"ARROW1\0\0", "an Arrow file", "Write it as Parquet."),
    _own_format(rb"\x89HDF\r\n\x1a\n", "an HDF5 file", ".h5", "hdf5"),
    _own_format(rb"MATLAB 5\.0", "a MATLAB file", ".mat", "mat"),
    _own_format(rb"MATLAB 7\.3", "a MATLAB file", ".mat", "mat", "hdf5"),
    _own_format(rb"PAR1", "a Parquet file", ".parquet", "parquet"),
    _own_format(rb"(?:RIFF|RF64|RIFX).{4}WAVE", "a WAV file", ".wav", "wav"),
    _own_format(rb"TDSm", "a TDMS file", ".tdms", "tdms"),
    _own_format(rb"(?:MDF|UnFinMF) {1,5}", "an MDF file", ".mf4", "mdf"),
)


def require_content(path: Path, module: str) -> None:
    """Refuse a file that is of another kind than its suffix states, and name its kind.

    Parameters
    ----------
    module : module of this package that reads the suffix.
    """
    kind, remedy, modules = _recognize(path)
    if kind and module not in modules:
        _refuse(path, kind, remedy)


def require_no_text(path: Path) -> None:
    """Refuse a file that could not be read because it is a text."""
    text = _describe_text(path)
    if text:
        _refuse(path, text, _RENAME_TEXT)


def _refuse(path: Path, kind: str, remedy: str) -> NoReturn:
    suffix = "".join(path.suffixes[-1:])
    raise DataError(f"{path} is {kind}, not a {suffix} file.", remedy=remedy)


def describe_content(path: Path) -> tuple[str, str]:
    """Return what a file is by its first bytes, and what to do about it; empty if unknown."""
    kind, remedy, _ = _recognize(path)
    text = _describe_text(path)
    if not kind and text:
        return text, _RENAME_TEXT
    return kind, remedy


def _recognize(path: Path) -> tuple[str, str, tuple[str, ...]]:
    """Return the kind of a file, what to do about it, and the modules that read it."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)

    for signature in _SIGNATURES:
        if re.match(signature.pattern, head, re.DOTALL):
            return signature.kind, signature.remedy, signature.modules
    if head.startswith(b"\x1f\x8b"):
        if path.suffix.lower() == ".gz":
            return "", "", ()
        return "a gzipped file", "Unpack it, or add .gz to the name of a text table.", ()
    if head.startswith(b"PK\x03\x04"):
        return _recognize_zip(path)
    return "", "", ()


def _recognize_zip(path: Path) -> tuple[str, str, tuple[str, ...]]:
    """Return the kind of a ZIP file by the names in it."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError):
        return "", "", ()

    folders = {name.partition("/")[0] for name in names}
    if "xl" in folders:
        return "an Excel workbook", _SAVE_AS_CSV, ()
    if folders & {"word", "ppt"}:
        return "a document of Office", "Export the samples as CSV.", ()
    if "content.xml" in names:
        return "a document of OpenDocument", _SAVE_AS_CSV, ()
    if names and all(name.endswith(".npy") for name in names):
        return "a NumPy archive", "Rename it to .npz.", ("npz",)
    return "a ZIP archive", _UNPACK, ("npz",)


def _describe_text(path: Path) -> str:
    """Return how a text begins, or an empty text if the file is something else."""
    with path.open("rb") as file:
        text = _decode_text(file.read(_HEAD_BYTES))
    return f"a text that begins with {text.splitlines()[0][:_MAX_QUOTE_LENGTH]!r}" if text else ""


def _decode_text(head: bytes) -> str:
    """Return the beginning of a text, or an empty text if it is something else."""
    is_utf_16 = head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    decoder = codecs.getincrementaldecoder("utf-16" if is_utf_16 else "utf-8-sig")()
    try:
        text = decoder.decode(head).strip()  # a character may be cut off at the end
    except UnicodeDecodeError:
        return ""
    is_printable = all(char.isprintable() or char.isspace() for char in text)
    return text if is_printable else ""
