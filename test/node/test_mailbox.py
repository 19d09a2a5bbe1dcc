from __future__ import annotations

import threading

from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.node.mailbox import Mailbox, Worker


@settings(max_examples=50, deadline=None)
@given(st.lists(st.booleans(), max_size=40))
def test_what_is_taken_is_always_the_newest_and_the_rest_is_counted(steps: list[bool]) -> None:
    mailbox: Mailbox[int] = Mailbox()
    put = taken = waiting = 0
    for is_put in steps:
        if is_put:
            put += 1
            mailbox.put(put)
            waiting = put
        elif waiting:
            assert mailbox.take() == put
            taken, waiting = taken + 1, 0
    assert mailbox.dropped == put - taken - bool(waiting)


def test_closing_wakes_the_reader_and_throws_away_what_waits() -> None:
    mailbox: Mailbox[int] = Mailbox()
    taken: list[int | None] = []
    reader = threading.Thread(target=lambda: taken.append(mailbox.take()))
    reader.start()
    mailbox.shut()
    reader.join(60)
    mailbox.put(1)
    assert taken == [None]
    assert mailbox.take() is None


def test_a_worker_works_on_the_newest_and_ends() -> None:
    is_busy, may_go_on = threading.Event(), threading.Event()
    done: list[int] = []

    def work(item: int) -> None:
        is_busy.set()
        assert may_go_on.wait(60)
        done.append(item)

    worker = Worker(work, "test")
    worker.put(0)
    assert is_busy.wait(60)
    for item in range(1, 10):
        worker.put(item)
    assert not worker.close(timeout_s=0.01)  # it is still busy with the first
    may_go_on.set()
    assert worker.close(timeout_s=60)
    assert done == [0]
    assert worker.dropped == 8


def test_a_worker_takes_the_last_of_many() -> None:
    is_busy, may_go_on, is_done = threading.Event(), threading.Event(), threading.Event()
    done: list[int] = []

    def work(item: int) -> None:
        is_busy.set()
        assert may_go_on.wait(60)
        done.append(item)
        if item == 9:
            is_done.set()

    worker = Worker(work, "test")
    worker.put(0)
    assert is_busy.wait(60)
    for item in range(1, 10):
        worker.put(item)
    may_go_on.set()
    assert is_done.wait(60)
    assert worker.close(timeout_s=60)
    assert done == [0, 9]
    assert worker.dropped == 8


def test_the_last_preparation_is_made_before_the_next_item_and_drops_none() -> None:
    is_busy, may_go_on, is_done, is_ready = (threading.Event() for _ in range(4))
    done: list[str] = []

    def work(item: str) -> None:
        is_busy.set()
        assert may_go_on.wait(5)
        done.append(item)
        if item == "second":
            is_done.set()

    worker = Worker(work, "test")
    worker.put("first")
    assert is_busy.wait(5)
    worker.prepare(lambda: done.append("a preparation that the next one replaces"))
    worker.put("second")
    worker.prepare(lambda: done.append(threading.current_thread().name))
    may_go_on.set()
    assert is_done.wait(5)
    worker.prepare(is_ready.set)
    assert is_ready.wait(5)  # without any item
    assert done == ["first", "test", "second"]
    assert worker.dropped == 0
    assert worker.close(timeout_s=5)
    worker.prepare(lambda: done.append("after the end"))
    assert len(done) == 3
