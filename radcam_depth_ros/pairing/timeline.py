"""One monotonic time for several streams of stamps, also across backward jumps."""

from __future__ import annotations

_SECOND = 1_000_000_000
_SEAM_NS = _SECOND
"""When one stream has jumped, the others follow within this time (of arrival)."""
_SEAM_GAP_NS = 3600 * _SECOND
"""How far apart stamps from before and after a jump are put."""


class Timeline:
    """Shifts stamps forward from each backward jump on (a looped bag, a reset clock).

    Each stream jumps at its own moment: messages from before and after the jump may be interleaved. The first stream
    to jump sets the shift, the others take it over at their own jump. A stream that comes back to where the others
    are, after a single wrong stamp, gets their shift again.

    Args:
        streams: How many there are.
        jump_ns: A stamp further than this behind the newest of its stream is a jump, and did not just come late.
    """

    def __init__(self, streams: int, jump_ns: int) -> None:
        self.resets = 0
        self.jump_ns = jump_ns
        self._shift_ns = 0  # for streams after the last jump
        self._shift_before_ns = 0  # for those still before it
        self._jumped_ns: int | None = None  # arrival of the last jump
        self._seam_ns = 0  # the stamp from which it went back
        self._shifts_ns = [0] * streams
        self._newest_ns: list[int | None] = [None] * streams  # stamps, since the stream's last jump
        self._arrived_ns = [0] * streams

    def unwrap(self, stream: int, stamp_ns: int, now_ns: int) -> int:
        """The stamp of a message that came at `now_ns`, on the time that goes on."""
        self._gather(stream, now_ns)
        newest_ns = self._newest_ns[stream]
        if newest_ns is None:
            self._shifts_ns[stream] = self._shift_ns
            newest_ns = stamp_ns
        elif abs(stamp_ns - newest_ns) > self.jump_ns:
            if self._is_straggler(stream, stamp_ns, now_ns):
                return stamp_ns + self._shift_before_ns
            newest_ns = self._follow_jump(stream, newest_ns, stamp_ns, now_ns)
        self._newest_ns[stream] = max(newest_ns, stamp_ns)
        self._arrived_ns[stream] = now_ns
        return stamp_ns + self._shifts_ns[stream]

    def _gather(self, stream: int, now_ns: int) -> None:
        """Ends the time in which streams may differ: one left behind starts anew with the others."""
        if self._jumped_ns is None or now_ns - self._jumped_ns <= _SEAM_NS:
            return
        if self._shift_ns not in self._shifts_ns:  # a wrong stamp, from which its stream has come back
            self._shift_ns = self._shifts_ns[stream]
        if self._shifts_ns[stream] != self._shift_ns:
            self._newest_ns[stream] = None

    def _follow_jump(self, stream: int, newest_ns: int, stamp_ns: int, now_ns: int) -> int:
        """Chooses the stream's shift after a jump; returns the newest stamp to count from."""
        for shift_ns in (self._shifts_ns[stream], self._shift_ns, self._shift_before_ns):
            if self._is_among_others(stream, stamp_ns, shift_ns, now_ns):
                self._shifts_ns[stream] = shift_ns
                return stamp_ns
        if stamp_ns > newest_ns:
            return newest_ns  # a pause
        if self._shifts_ns[stream] == self._shift_ns:
            self.resets += 1
            self._jumped_ns, self._seam_ns = now_ns, newest_ns
            self._shift_before_ns = self._shift_ns
            self._shift_ns += newest_ns - stamp_ns + _SEAM_GAP_NS
        self._shifts_ns[stream] = self._shift_ns
        return stamp_ns

    def _is_straggler(self, stream: int, stamp_ns: int, now_ns: int) -> bool:
        """Whether a message from before the last jump comes when its stream has jumped."""
        return (
            self._jumped_ns is not None
            and now_ns - self._jumped_ns <= _SEAM_NS
            and self._shifts_ns[stream] == self._shift_ns
            and abs(stamp_ns - self._seam_ns) <= self.jump_ns
        )

    def _is_among_others(self, stream: int, stamp_ns: int, shift_ns: int, now_ns: int) -> bool:
        return any(
            other != stream
            and newest_ns is not None
            and self._shifts_ns[other] == shift_ns
            and now_ns - self._arrived_ns[other] <= _SEAM_NS
            and abs(stamp_ns - newest_ns) <= self.jump_ns
            for other, newest_ns in enumerate(self._newest_ns)
        )
