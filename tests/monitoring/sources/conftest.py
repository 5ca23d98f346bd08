"""A spool for the tests of sources, which remembers what was delivered."""

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from swashtwin.monitoring.sources.delivery import Delivery
from swashtwin.monitoring.sources.spool import Spool


@dataclass
class Deliveries:
    """Keep what is delivered, after `failures` deliveries were refused as by a full disk."""

    spool: Spool
    failures: int = 0
    items: list[tuple[Delivery, bytes]] = field(default_factory=list)

    def accept(self, delivery: Delivery, content: bytes | Path) -> str:
        """Take a delivery."""
        if self.failures:
            self.failures -= 1
            raise OSError(28, "No space left on device")

        assert isinstance(content, bytes)
        self.items.append((delivery, content))
        return self.spool.add(delivery, content)


@pytest.fixture
def deliveries(tmp_path: Path) -> Deliveries:
    """An empty spool that remembers its deliveries."""
    return Deliveries(Spool(tmp_path / "spool"))
