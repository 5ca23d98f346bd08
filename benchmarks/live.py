"""Record the reference device of openDAQ for a while: samples lost, processor time and memory.

    python benchmarks/live.py --minutes 60

Three channels count up with each sample, by the time between two. So a lost, repeated or altered
sample shows itself, also between two recordings. The reference device counts whole microseconds and
gives 50 kHz, not 51.2 kHz. It computes its signals in this process; its own share of a core is
measured before, and is part of the total. At the end the device is removed, as if its cable were
pulled, and must be recorded again.
"""

import argparse
import shutil
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from swashtwin.monitoring import DeviceSettings, LiveRecorder, LiveSettings
from swashtwin.recordings import Finding, Recording, write_recording

RATE_HZ = 50e3
N_CHANNELS = 3
LENGTH_S = 10.0
IDLE_S = 20.0
"""Time for which the share of the device alone is measured."""
COUNTER = 3
"""Number of the waveform that counts up."""


def main() -> None:
    """Record, and print the result as lines."""
    parser = argparse.ArgumentParser(description="Record the reference device of openDAQ.")
    parser.add_argument("--minutes", type=float, default=60.0)
    duration = 60 * parser.parse_args().minutes

    device = DeviceSettings(
        "daqref://device0", sample_rate=RATE_HZ, properties={"NumberOfChannels": str(N_CHANNELS)}
    )
    recorder = LiveRecorder(LiveSettings(device, LENGTH_S))
    idle_share = measure_idle(recorder)
    folder = Path(tempfile.mkdtemp(prefix="live-"))
    try:
        record(recorder, duration, folder, idle_share)
        pull_cable(recorder)
    finally:
        recorder.close()
        shutil.rmtree(folder)


def measure_idle(recorder: LiveRecorder) -> float:
    """Return the share of a core that the device takes while nobody reads it."""
    reader = recorder._device._reader
    reader.active = False
    start = time.monotonic()
    processor_time = time.process_time()
    time.sleep(IDLE_S)
    share = (time.process_time() - processor_time) / (time.monotonic() - start)
    reader.active = True
    recorder._device.set_up()
    return share


def record(recorder: LiveRecorder, duration: float, folder: Path, idle_share: float) -> None:
    """Record for `duration` seconds, and print what was lost and what it took."""
    count_up(recorder)
    start = time.monotonic()
    processor_time = time.process_time()
    checking_time = 0.0
    n_recordings = 0
    n_samples = 0
    n_lost = 0
    last: np.ndarray | None = None
    memory: list[float] = []
    findings: list[Finding] = []

    for item in recorder.run(threading.Event()):
        if isinstance(item, Finding):
            findings.append(item)
            print(f"{item.kind}: {item.message}", flush=True)
            continue

        path = write_recording(item, folder / f"{item.recording_id}.h5")
        path.unlink()
        before_check = time.process_time()
        n_lost += count_lost(item, last)
        last = item.signal[:, -1:]
        checking_time += time.process_time() - before_check

        n_recordings += 1
        n_samples += item.n_samples
        memory.append(memory_mb())
        if time.monotonic() - start >= duration:
            break

    elapsed = time.monotonic() - start
    share = (time.process_time() - processor_time - checking_time) / elapsed
    settled = memory[len(memory) // 4 :]
    print(f"recorded: {n_recordings} recordings, {n_samples} samples x {N_CHANNELS}")
    print(f"time: {elapsed:.0f} s; samples of {n_samples / RATE_HZ:.0f} s")
    print(f"lost, repeated or altered: {n_lost}; findings: {len(findings)}")
    print(f"share of a core: {100 * share:.1f} %, of it the device {100 * idle_share:.1f} %")
    print(
        f"memory [MB]: first recording {memory[0]:.0f}, after a quarter {settled[0]:.0f}, "
        f"maximum since {max(settled):.0f}, end {memory[-1]:.0f}"
    )


def count_up(recorder: LiveRecorder) -> None:
    """Let all channels count, and discard the samples of before."""
    device = recorder._device
    for channel in device._device.channels:
        channel.set_property_value("Waveform", COUNTER)
    time.sleep(1.0)
    device.set_up()


def count_lost(recording: Recording, last: np.ndarray | None) -> int:
    """Return how many steps of the channels are not that of one sample."""
    signal = recording.signal
    if last is not None:
        signal = np.concatenate([last, signal], axis=1)
    steps = np.diff(signal, axis=1) * RATE_HZ
    return int((np.abs(steps - 1) > 1e-6).sum())


def pull_cable(recorder: LiveRecorder) -> None:
    """Remove the device while it is recorded, and print what is reported until it is back."""
    is_pulled = False
    for item in recorder.run(threading.Event()):
        if isinstance(item, Finding):
            print(f"{item.kind}: {item.message}", flush=True)
        if not is_pulled:
            device = recorder._device
            threading.Timer(2.0, device._instance.remove_device, (device._device,)).start()
            is_pulled = True
        elif isinstance(item, Recording) and item.n_samples == round(LENGTH_S * RATE_HZ):
            return


def memory_mb() -> float:
    """Return the memory of this process [MB]."""
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    raise RuntimeError("/proc/self/status has no VmRSS")


if __name__ == "__main__":
    main()
