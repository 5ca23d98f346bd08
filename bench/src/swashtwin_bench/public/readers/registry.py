"""Public sets of recordings, each read as it was published, with the groups that an honest split must keep apart.

A set's reader takes the folder of its files and gives recordings whose `attributes` name the groups; its docstring says
which attribute is which, and what misleads in the set. No data comes with this package.

=========================  ======================================  ===========================================
set                        labels                                  groups (attributes, or ``specimen``)
=========================  ======================================  ===========================================
``bearing_run_to_failure`` none: six bearings until they failed    ``specimen``
``cwru``                   normal, inner_race, ball, outer_race    ``specimen``, ``fault_size_mil``, ``end``
``motor_pump_industrial``  healthy, faulty                         ``block``
``pump_cavitation``        healthy, cavitation25, 50, 75, 100      ``speed_nominal``, ``repeat``
``uci_hydraulic``          no_, weak_, severe_leakage              ``pump_run``, ``cooler_block``
=========================  ======================================  ===========================================
"""

from collections.abc import Callable
from pathlib import Path

from swashtwin.foundation import InputError
from swashtwin.recordings import Recording
from swashtwin_bench.public.readers.bearing_run_to_failure import read_bearing_run_to_failure
from swashtwin_bench.public.readers.cwru import read_cwru
from swashtwin_bench.public.readers.motor_pump_industrial import read_motor_pump_industrial
from swashtwin_bench.public.readers.pump_cavitation import read_pump_cavitation
from swashtwin_bench.public.readers.uci_hydraulic import read_uci_hydraulic

PUBLIC_SETS: dict[str, Callable[[Path], list[Recording]]] = {
    "bearing_run_to_failure": read_bearing_run_to_failure,
    "cwru": read_cwru,
    "motor_pump_industrial": read_motor_pump_industrial,
    "pump_cavitation": read_pump_cavitation,
    "uci_hydraulic": read_uci_hydraulic,
}
"""Reader of each set by its name."""


def read_public_set(name: str, folder: Path | str) -> list[Recording]:
    """Every recording of the public set `name`, in a fixed order.

    Parameters
    ----------
    name : one of `PUBLIC_SETS`.
    folder : where its files are, as published or as unpacked; it is only read.

    Raises
    ------
    InputError
        There is no such set.
    DataError
        The folder holds none of its files, or one is damaged.
    """
    if name not in PUBLIC_SETS:
        raise InputError(f"{name!r} is no public set that is known; there are {', '.join(PUBLIC_SETS)}.")
    return PUBLIC_SETS[name](Path(folder))
