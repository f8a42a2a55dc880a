"""Timing things against each other, in turn.

A machine's speed drifts; a ratio of two figures taken minutes apart says little. Here every round measures each
candidate once, in a fresh random order, and the ratio is taken within the round. What is reported is the median over
the rounds, with quartiles. The clock is processor time, so that a process which is pushed off its core does not count
the wait, and threads that a candidate starts do count.

Import this before NumPy: it keeps linear algebra on one thread and takes away settings that force a slower OpenBLAS.
"""

import gc
import os
import random
import statistics
import time
import timeit
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

for setting in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[setting] = "1"
for setting in ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"):
    os.environ.pop(setting, None)


def pin_to_one_core() -> None:
    """Keep this process on the last processor it may use."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def quartiles(values: list[float]) -> dict[str, float]:
    """Median and quartiles of a list of at least two numbers."""
    lower, middle, upper = statistics.quantiles(values, n=4, method="inclusive")
    return {"median": middle, "lower_quartile": lower, "upper_quartile": upper, "least": min(values)}


def in_turn(candidates: Mapping[str, Callable[[], object]], *, rounds: int = 25) -> dict[str, list[float]]:
    """Run each candidate once a round and return its processor seconds, round by round.

    Each result is kept until the clock has stopped and is then dropped, so that freeing it is not timed.
    """
    seconds: dict[str, list[float]] = {name: [] for name in candidates}
    for run in candidates.values():
        run()
    order = list(candidates)
    shuffle = random.Random(0).shuffle
    gc.disable()
    try:
        for _ in range(rounds):
            shuffle(order)
            for name in order:
                run = candidates[name]
                start = time.process_time_ns()
                result = run()
                seconds[name].append((time.process_time_ns() - start) * 1e-9)
                del result
    finally:
        gc.enable()
    return seconds


def calls_in_turn(
    statements: Mapping[str, tuple[str, dict[str, object]]], *, rounds: int = 41, slot: float = 0.01
) -> dict[str, list[float]]:
    """Time short statements: processor seconds per call, round by round.

    Every statement comes with the names it uses. It is repeated inside one slot of about ``slot`` seconds, in the
    loop that `timeit` generates, so a call through a function of ours is not added to it.
    """
    timers = {
        name: timeit.Timer(statement, timer=time.process_time, globals=names)
        for name, (statement, names) in statements.items()
    }
    repeats = {
        name: max(1, round(slot * count / spent))
        for name, (count, spent) in ((name, _autorange(timer)) for name, timer in timers.items())
    }
    runs = {name: (lambda t=timer, n=repeats[name]: t.timeit(n)) for name, timer in timers.items()}
    seconds = in_turn(runs, rounds=rounds)
    return {name: [value / repeats[name] for value in values] for name, values in seconds.items()}


class Task(NamedTuple):
    """One candidate of `each_in_turn`: what it runs, on which inputs one after another, and what is done before a round."""

    run: Callable[[Any], object]
    inputs: Sequence[Any]
    before: Callable[[], object]


def each_in_turn(
    tasks: Mapping[str, Task], *, rounds: int = 15, clock: Callable[[], int] = time.perf_counter_ns
) -> dict[str, list[list[float]]]:
    """Run each task once a round on every one of its inputs; seconds of each call, round by round.

    To read the clock of the process takes a quarter of a microsecond, much for calls of a few, so this is the clock on
    the wall unless another is given: take medians over rounds, which leave interruptions out. What an empty
    measurement shows is taken off, and a result is dropped when the clock has stopped.
    """
    seconds: dict[str, list[list[float]]] = {name: [] for name in tasks}
    order = list(tasks)
    shuffle = random.Random(0).shuffle
    empty = statistics.median(-(clock() - clock()) for _ in range(1001))
    for task in tasks.values():
        task.before()
        task.run(task.inputs[0])
    gc.disable()
    try:
        for _ in range(rounds):
            shuffle(order)
            for name in order:
                run, inputs, before = tasks[name]
                before()
                spent = []
                for one in inputs:
                    start = clock()
                    result = run(one)
                    end = clock()
                    del result
                    spent.append((end - start - empty) * 1e-9)
                seconds[name].append(spent)
    finally:
        gc.enable()
    return seconds


def _autorange(timer: timeit.Timer) -> tuple[int, float]:
    """A number of calls that takes at least 2 ms, and what they took; what the first call sets up does not count."""
    timer.timeit(1)
    count = 1
    while True:
        spent = timer.timeit(count)
        if spent >= 2e-3:
            return count, spent
        count *= 4


def ratio(slower: list[float], faster: list[float]) -> dict[str, float]:
    """How many times longer ``slower`` took than ``faster``, round by round."""
    return quartiles([a / b for a, b in zip(slower, faster, strict=True)])
