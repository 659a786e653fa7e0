"""Work on the portions of an ordering, on as many threads as this process may use.

What comes out is the same on any number of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from synthnet.processes import threads
from synthnet.spectrum.ordering import Ordering

Answer = TypeVar("Answer")


def side_by_side(work: Callable[[int], Answer], ordering: Ordering) -> Iterator[Answer]:
    """Yield what work on each subtree returns, in order."""
    workers = min(threads(), ordering.subtrees)
    if workers <= 1:
        yield from map(work, range(ordering.subtrees))
        return
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(work, range(ordering.subtrees))


def in_turn(work: Callable[[int], Answer], ordering: Ordering) -> Iterator[Answer]:
    """Yield what work on each portion returns, in order.

    Subtrees are worked on side by side, and then each front above them after its children.
    """
    yield from side_by_side(work, ordering)
    fronts = ordering.portions[ordering.subtrees :, 0].tolist()
    workers = min(threads(), len(fronts))
    if workers <= 1:
        yield from map(work, range(ordering.subtrees, len(ordering.portions)))
        return
    with ThreadPoolExecutor(workers) as pool:
        futures: dict[int, Future[Answer]] = {}

        def after_children(portion: int, front: int) -> Answer:
            child = ordering.child[front]
            while child >= 0:
                if child in futures:
                    futures[child].result()
                child = ordering.sibling[child]
            return work(portion)

        for portion, front in enumerate(fronts, ordering.subtrees):  # waits for earlier ones only
            futures[front] = pool.submit(after_children, portion, front)
        for front in fronts:
            yield futures[front].result()
