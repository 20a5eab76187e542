"""The mailbox: the latest item only, and who puts never waits."""

import threading

from wbc.view.live.mailbox import Mailbox


def test_a_slow_taker_sees_items_in_order_and_the_last_one() -> None:
    box = Mailbox[int]()
    seen = list[int]()
    done = threading.Event()

    def take() -> None:
        while not done.is_set() or not seen or seen[-1] != 19_999:
            item = box.take()
            if item is not None:
                seen.append(item)

    taker = threading.Thread(target=take)
    taker.start()
    for item in range(20_000):  # never waits for the taker
        box.put(item)
    done.set()
    taker.join(10.0)
    assert not taker.is_alive()
    assert seen[-1] == 19_999
    assert seen == sorted(set(seen))
    assert box.dropped == 20_000 - len(seen)
    box.put(7)
    assert box.dropped == 20_000 - len(seen)  # it waits, and may still be taken
