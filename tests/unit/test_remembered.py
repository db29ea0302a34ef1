"""What candidates that are refitted in threads share."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor

from pzt_ros.sysid.remembered import Remembered


def test_computes_once_and_forgets_the_oldest() -> None:
    asked = []
    remembered: Remembered[str] = Remembered(2)

    def value_of(key: bytes) -> str:
        return remembered.get(key, lambda: asked.append(key) or key.decode())

    assert [value_of(key) for key in (b"a", b"b", b"a", b"c", b"b")] == ["a", "b", "a", "c", "b"]
    assert asked == [b"a", b"b", b"c"]
    assert value_of(b"a") == "a"
    assert asked == [b"a", b"b", b"c", b"a"]


def test_threads_that_share_it_get_their_own_values() -> None:
    remembered: Remembered[int] = Remembered(3)
    keys = [number % 17 for number in range(4000)]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda n: remembered.get(b"%d" % n, lambda: n * n), keys))
    assert found == [n * n for n in keys]


def test_a_copy_for_another_process_starts_empty() -> None:
    remembered: Remembered[int] = Remembered(3)
    remembered.get(b"a", lambda: 1)
    assert pickle.loads(pickle.dumps(remembered)).get(b"a", lambda: 2) == 2
