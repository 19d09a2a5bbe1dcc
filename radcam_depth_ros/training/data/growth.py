"""Prepares bags that come while a network trains, so that it learns from them, too."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from threading import Event, Lock, Thread

from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.training.data.samples import CachedDrive


class Growth:
    """Looks for new bags in a thread of its own, from entering to leaving the context.

    Args:
        find: All bags that are there now.
        prepare: Makes their samples; refuses those that must not be learned from.
        known: Bags that are learned from already, or never.
        on_note: Told of bags that cannot be learned from, a sentence each.
        every_s: Seconds between two looks.
    """

    def __init__(
        self,
        find: Callable[[], Sequence[str]],
        prepare: Callable[[Sequence[Path]], Sequence[CachedDrive]],
        known: Collection[str],
        on_note: Callable[[str], None],
        every_s: float,
    ) -> None:
        self._find = find
        self._prepare = prepare
        self._known = {*known}
        self._on_note = on_note
        self._every_s = every_s
        self._ready: list[Path] = []
        self._lock, self._end = Lock(), Event()
        self._thread = Thread(target=self._look, name="growth", daemon=True)

    def __enter__(self) -> Growth:
        self._thread.start()
        return self

    def __exit__(self, *reason: object) -> None:
        self._end.set()
        # Bags that are being prepared are finished: their samples are kept for the next run.
        self._thread.join()

    def take(self) -> tuple[Path, ...]:
        """Folders of the drives that were prepared since this was asked last."""
        with self._lock:
            ready, self._ready = tuple(self._ready), []
        return ready

    def _look(self) -> None:
        while not self._end.wait(self._every_s):
            try:
                bags = [Path(bag) for bag in self._find() if bag not in self._known]
            except RadcamDepthError:
                # A place that cannot be reached now may be later; there was one when the run began.
                continue
            self._known.update(str(bag) for bag in bags)
            drives = self._prepared(bags) if bags else ()
            with self._lock:
                self._ready += [drive.folder for drive in drives]

    def _prepared(self, bags: Sequence[Path]) -> Sequence[CachedDrive]:
        """The drives of some bags; where one of them fails each is tried by itself."""
        try:
            return self._prepare(bags)
        except RadcamDepthError as error:
            if len(bags) == 1:
                self._on_note(f"{bags[0]} is left out: {error}")
                return ()
        return [drive for bag in bags for drive in self._prepared([bag])]
