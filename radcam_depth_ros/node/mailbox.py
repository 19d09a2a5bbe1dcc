"""Mailbox for one item and the thread that empties it: the newest frame is processed, older ones are dropped."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

ItemT = TypeVar("ItemT")


class Mailbox(Generic[ItemT]):
    """Holds the newest item only, so that a slow reader is never behind by more than the item it works on.

    Beside the item it holds a preparation: a call that the reader makes before it takes the next item.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._item: ItemT | None = None
        self._preparation: Callable[[], None] | None = None
        self._closed = False
        self._dropped = 0

    @property
    def dropped(self) -> int:
        """How many items were replaced by a newer one before anybody took them."""
        return self._dropped

    def put(self, item: ItemT) -> None:
        """Leaves an item; one that still waits is dropped and counted. After `shut` this does nothing."""
        with self._changed:
            if self._closed:
                return
            self._dropped += self._item is not None
            self._item = item
            self._changed.notify()

    def prepare(self, call: Callable[[], None]) -> None:
        """Leaves a preparation, in place of one that still waits. After `shut` this does nothing."""
        with self._changed:
            if not self._closed:
                self._preparation = call
                self._changed.notify()

    def take(self) -> ItemT | None:
        """Waits for an item, and makes preparations while it waits; None when the mailbox was closed."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._item is not None or self._preparation is not None)
                preparation, self._preparation = self._preparation, None
                if preparation is None:
                    item, self._item = self._item, None
                    return item
            # Not under the lock: items come meanwhile.
            preparation()

    def shut(self) -> None:
        """Throws away what waits and wakes the reader for good."""
        with self._changed:
            self._closed = True
            self._item = self._preparation = None
            self._changed.notify_all()


class Worker(Mailbox[ItemT]):
    """A mailbox with a thread that works on its newest item, and makes preparations before.

    Args:
        work: Called in the thread with each item that is taken. It handles its own errors, as preparations do.
        name: The thread's name.
    """

    def __init__(self, work: Callable[[ItemT], None], name: str) -> None:
        super().__init__()
        self._work = work
        # A daemon, since a network in the middle of an image must not keep a process from ending.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def close(self, timeout_s: float | None = None) -> bool:
        """Ends the thread after the item it works on; False when that took longer than `timeout_s`."""
        self.shut()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (item := self.take()) is not None:
            self._work(item)
