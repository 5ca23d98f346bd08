"""Recordings from files of ten formats, and one index that says what each file is.

A folder of measurements becomes a data set by one file, ``recordings.toml``::

    format = 1
    classes = ["normal", "Schiefscheibe"]

    [fault_of]                        # fault of the twin that a class stands for, under another
    name Schiefscheibe = "swash_plate"

    [defaults]                        # any key of an entry, for every entry that lacks it
    sample_rate = "25.6 kHz"
    unit = "g"

    [[recording]]
    file = "A01/normal_1.mat"
    label = "normal"
    specimen = "A"
    speed = "860 rpm"
    pressure = "15 MPa"
    channels = ["X105_DE_time"]       # names, patterns such as "*_DE_time", or numbers from 0
    names = ["drive_end"]
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
