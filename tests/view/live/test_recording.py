"""The recording: looked up by time, begun anew by a restart, and thinned when it is long."""

import numpy as np

from wbc.view.live.controls import Recording
from wbc.view.live.messages import Frame


def frame(time: float) -> Frame:
    return Frame(time, np.zeros(7), np.zeros(6))


def recording(times: list[float], most: int = 100) -> Recording:
    kept = Recording(most)
    for time in times:
        kept.add(frame(time), None)
    return kept


def time_at(kept: Recording, time: float) -> float:
    found = kept.at(time)
    assert found is not None
    return found[0].time


def test_the_frame_before_a_time() -> None:
    kept = recording([0.0, 0.1, 0.2, 0.3])
    assert [time_at(kept, t) for t in (-1.0, 0.0, 0.15, 0.3, 9.0)] == [0.0, 0.0, 0.1, 0.3, 0.3]
    assert kept.span == (0.0, 0.3)
    assert Recording().at(0.0) is None
    assert Recording().latest is None


def test_the_same_time_again_replaces() -> None:
    kept = recording([0.0, 0.1])
    again = frame(0.1)
    kept.add(again, None)
    assert len(kept) == 2
    assert kept.latest is not None
    assert kept.latest[0] is again


def test_a_restart_begins_anew() -> None:
    assert recording([0.0, 0.1, 0.2, 0.0]).span == (0.0, 0.0)


def test_a_long_recording_keeps_its_span_and_its_end() -> None:
    times = [0.01 * k for k in range(1000)]
    kept = recording(times, most=100)
    assert len(kept) <= 100
    assert kept.span == (0.0, times[-1])
    assert [time_at(kept, t) for t in times[-50:]] == times[-50:]
