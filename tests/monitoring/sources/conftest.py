"""What a source hands its deliveries to."""

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from swashtwin.monitoring.sources.delivery import Delivery
from swashtwin.monitoring.sources.spool import Spool


@dataclass
class Deliveries:
    """Keeps what is delivered; the first `failures` deliveries are refused as by a full disk."""

    spool: Spool
    failures: int = 0
    items: list[tuple[Delivery, bytes]] = field(default_factory=list)

    def accept(self, delivery: Delivery, content: bytes | Path) -> str:
        """Takes a delivery."""
        if self.failures:
            self.failures -= 1
            raise OSError(28, "No space left on device")
        assert isinstance(content, bytes)
        self.items.append((delivery, content))
        return self.spool.add(delivery, content)


@pytest.fixture
def deliveries(tmp_path: Path) -> Deliveries:
    """A spool that remembers what came."""
    return Deliveries(Spool(tmp_path / "spool"))
