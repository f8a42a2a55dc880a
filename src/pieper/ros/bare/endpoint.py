"""What all ends of topics and services have in common: they enter a participant, leave it, and may enter another."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pieper.ros.bare.participant import Participant


class Endpoint(ABC):
    """Something that a node has on the network, while it is on the network and while it is not.

    Attributes
    ----------
    on_close : callable, optional
        Called once, with the endpoint, when it is closed for good.
    """

    on_close: Callable[[Endpoint], None] | None = None

    @abstractmethod
    def open(self, participant: Participant) -> None:
        """Enter a participant."""

    @abstractmethod
    def leave(self) -> None:
        """Leave the participant; :meth:`open` enters another one."""

    @property
    @abstractmethod
    def reader_guids(self) -> Sequence[bytes]:
        """What DDS calls the readers of this endpoint, 16 bytes each."""

    @property
    @abstractmethod
    def writer_guids(self) -> Sequence[bytes]:
        """What DDS calls the writers of this endpoint, 16 bytes each."""

    def complaint(self) -> str | None:
        """Return a sentence about what went wrong since the last time, if anything did."""
        return None

    def close(self) -> None:
        """Leave the network for good."""
        self.leave()
        on_close, self.on_close = self.on_close, None
        if on_close is not None:
            on_close(self)
