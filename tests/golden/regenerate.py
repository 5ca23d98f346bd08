"""Write the golden files and docs/reference/json.md anew: ``python tests/golden/regenerate.py [NAME
...]``.

Use it only if a change of numbers or of the interface is intended and listed in CHANGELOG.md. A
golden test that fails after any other change has found a mistake: fix that instead. Review the
changes (git diff) before you commit them.
A name is that of a file without ``.json``, such as ``calibration`` or ``answer_train``; without a
name all are written.
"""

import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

FOLDER = Path(__file__).parent


def regenerate(names: list[str]) -> None:
    """Write the golden files of these names, or all of them."""
    import torch
    from golden_commands import COMMANDS, Workspace
    from golden_files import save_golden
    from golden_rig import plant_recordings
    from golden_values import VALUES
    from json_page import PAGE, page_text
    from stored_keys import STORED_KEYS, save_stored_keys

    torch.set_num_threads(1)
    answers = {f"answer_{name}": name for name in COMMANDS}
    golden_names = [*VALUES, STORED_KEYS, *answers]
    unknown = sorted({*names} - {*golden_names})
    if unknown:
        sys.exit(f"{', '.join(unknown)}: no golden file; there are {', '.join(golden_names)}.")
    plant = plant_recordings()
    with TemporaryDirectory() as temporary:
        folder = Path(temporary).resolve()
        (folder / "values").mkdir()
        (folder / "workspace").mkdir()
        workspace = Workspace(plant, folder / "workspace")

        for name, value in VALUES.items():
            if not names or name in names:
                save_golden(name, value(plant, folder / "values"))

        if not names or STORED_KEYS in names:
            save_stored_keys(folder)

        for name, command in answers.items():
            if not names or name in names:
                save_golden(name, workspace.answer(command))

    PAGE.write_text(page_text(), encoding="utf-8")


if __name__ == "__main__":
    sys.path[:0] = [str(FOLDER), str(FOLDER.parent / "support")]
    regenerate(sys.argv[1:])
