"""The context of a run: the time left, from shares done and a clock that the test moves; and its processes."""

import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot.progress import (
    EtaEstimator,
    Progress,
    ProgressReporter,
    Stage,
    TimedStage,
    as_clock,
    by_stage_times,
    in_parts,
    part_of,
    slowdown_now,
)
from tests.support.processes import PATIENCE, Child


class Clock:
    """A clock that stands still until it is moved."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def watched(steps: list[tuple[float, float]]) -> tuple[EtaEstimator, Clock, list[float | None]]:
    """Return the time left after each step of so many seconds to a share."""
    clock = Clock()
    pace = EtaEstimator(clock)
    left = []
    for seconds, share in steps:
        clock.now += seconds
        left.append(pace.seconds_left(at(share)))
    return pace, clock, left


def at(share: float) -> Progress:
    return Progress(stage="", done=share, total=1.0)


@given(step=st.floats(1.0, 1e4), count=st.integers(2, 50), first=st.floats(0.0, 1e5))
def test_steady_progress_is_predicted_exactly_despite_a_slow_first_step(step, count, first):
    """The first step compiles: of 54 s for 1/3000 of the work, 45 hours were foretold."""
    _, _, left = watched([(first, 1 / count), *((step, done / count) for done in range(2, count + 1))])
    assert left[0] is None
    # rounding of the shares' differences, of 1e-16 each and no smaller than 1/50
    expected = [step * (count - done) for done in range(2, count + 1)]
    assert left[1:] == [pytest.approx(one, rel=1e-9, abs=1e-9 * (first + step)) for one in expected]


def test_checkpointed_steps_do_not_affect_the_time_left():
    read = [(1e-3, done / 100) for done in range(1, 51)]
    _, _, left = watched([*read, (60.0, 0.51)])
    assert left[:-1] == [None] * 50
    assert left[-1] == pytest.approx(49 * 60.0, rel=1e-6)


def test_simultaneous_steps_do_not_count_as_fast_progress():
    waits = [60.0, *[1e-3] * 15] * 10  # sixteen threads, each step takes a minute
    _, _, left = watched([(wait, (i + 1) / 320) for i, wait in enumerate(waits)])
    foretold = [one for one in left[33:] if one is not None]
    # within a whole burst's share of the time left: 10 minutes
    assert foretold[-1] == pytest.approx(600.0, rel=0.25)
    assert max(foretold) < 2.0 * 19 * 60.0


def test_time_left_grows_while_no_step_finishes():
    pace, clock, left = watched([(1.0, 0.1), (1.0, 0.2), (1.0, 0.3), (1.0, 0.4)])
    assert left[-1] == pytest.approx(6.0)
    clock.now += 60.0
    assert pace.seconds_left(at(0.4)) == pytest.approx(63.0 / 0.3 * 0.6)


def test_time_left_between_two_steps_falls_but_not_to_nothing():
    pace, clock, left = watched([(0.0, 0.0), (60.0, 0.1), (60.0, 0.2)])
    assert pace.seconds_left_now() == left[-1] == pytest.approx(480.0)
    clock.now += 90.0
    assert pace.seconds_left_now() == pytest.approx(390.0)
    clock.now = clock.now - 90.0 + 600.0  # the step takes longer than all that was expected
    assert pace.seconds_left_now() == pytest.approx(200.0)


def test_the_time_of_a_stage_follows_that_of_the_stage_it_follows():
    """The machine takes three times as long as usual for the horizon, and is as fast as usual otherwise."""
    clock, shown = Clock(), list[Progress]()
    plan = {
        "horizon": TimedStage(seconds=2.0),
        "law a": TimedStage(seconds=6.0, follows="horizon"),
        "law b": TimedStage(seconds=2.0),
    }
    report = by_stage_times(shown.append, plan, clock=clock)
    for seconds, stage, done in ((0.0, "horizon 0.1 s", 0), (3.0, "horizon 0.2 s", 1), (3.0, "law a", 0)):
        clock.now += seconds
        report(Progress(stage=stage, done=done, total=2))
    # 10 s as planned; half of the horizon took 3 s; law a takes three times its usual time, and law b, of which nothing
    # is known, about as much
    assert [one.seconds_left for one in shown[:2]] == pytest.approx([10.0, 11.0])
    assert shown[2].seconds_left == pytest.approx(18.0 + 2.0 * (0.5 + 6.0) / (0.5 + 2.0))
    clock.now += 24.0  # law a takes longer than was expected
    report(Progress(stage="something new", done=1, total=2))
    assert shown[3].seconds_left > 8.0
    report(Progress(stage="end", done=0, total=1, share=1.0))
    shares = [one.share for one in shown]
    assert shares == pytest.approx([0.0, 0.1, 0.2, 0.2, 1.0])


def test_no_time_left_before_the_first_step():
    assert watched([(1.0, 0.0)])[2] == [None]


@given(st.lists(st.floats(0.0, 1.0), min_size=2, max_size=20), st.floats(0.0, 10.0))
def test_time_left_is_never_negative(shares, seconds):
    left = watched([(seconds, share) for share in shares])[2]
    assert all(one is None or one >= 0.0 for one in left)


def test_what_was_planned_takes_longer_on_a_busy_machine(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 4)
    monkeypatch.setattr("ballbot.progress._BEGUN", time.monotonic())
    monkeypatch.setattr("ballbot.progress.process_time", lambda: 0.0)
    for ready, slowdown in ((0.0, 1.0), (2.0, 1.5), (4.0, 2.0), (80.0, 4.0)):
        monkeypatch.setattr("os.getloadavg", lambda ready=ready: (ready, 0.0, 0.0), raising=False)
        assert slowdown_now() == slowdown
    # half a minute of this process on four cores is half of what was ready in the minute
    monkeypatch.setattr("os.getloadavg", lambda: (4.0, 0.0, 0.0))
    monkeypatch.setattr("ballbot.progress.process_time", lambda: 120.0)
    assert slowdown_now() == pytest.approx(1.5)
    monkeypatch.delattr("os.getloadavg")  # as on Windows
    assert slowdown_now() == 1.0

    clock = Clock()
    pace = EtaEstimator(clock, slowdown=2.0)
    clock.now += 1.0
    plan = Progress(stage="a", done=1, total=10, planned=20.0)
    assert pace.seconds_left(plan) == pytest.approx(2.0 * 20.0 * 0.9)
    # what is measured replaces it: 10 s for each tenth, so that the prior of 0.3 s hardly counts
    for done in range(2, 6):
        clock.now += 10.0
        left = pace.seconds_left(replace(plan, done=done, share=0.1 * done))
    assert left == pytest.approx(50.0, rel=0.05)


def test_plan_gives_the_time_left_until_there_is_a_pace():
    clock = Clock()
    pace = EtaEstimator(clock)
    clock.now += 50.0  # compiling
    first = pace.seconds_left(Progress(stage="a", done=1, total=10, planned=20.0))
    assert first == pytest.approx(18.0)
    clock.now += 40.0
    later = pace.seconds_left(Progress(stage="a", done=2, total=10, planned=20.0))
    assert later == pytest.approx(8 * 40.0, rel=0.25)


def test_slow_first_step_of_a_later_stage_does_not_set_the_pace():
    clock = Clock()
    pace = EtaEstimator(clock)
    left = None
    for step in range(1, 41):
        stage = "a" if step <= 20 else "b"
        clock.now += 100.0 if step == 21 else 1.0
        left = pace.seconds_left(Progress(stage=stage, done=step, total=40))
        if step > 2:
            assert left is not None
            assert 0.99 * (40 - step) <= left <= 1.2 * (40 - step)
    assert left == 0.0


def test_stage_that_takes_more_steps_than_usual_does_not_speed_up_the_pace():
    shown: list[Progress] = []
    stages = [
        Stage(name="search", steps=100, work=1.0, usual=20),
        Stage(name="rest", steps=10, work=2.0),
    ]
    reporter = ProgressReporter(shown.append, stages)
    for step in range(1, 41):
        reporter(Progress(stage="search", done=step, total=100))
    for step in range(1, 11):
        reporter(Progress(stage="rest", done=step, total=10))
    reporter.end()
    shares = [one.share for one in shown]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    worked = np.cumsum([*np.diff([0.0, *shares])] - np.array([one.skipped for one in shown]))
    assert worked[39] == pytest.approx(40 / 40)  # of 20 usual steps and 20 of the rest
    assert worked[-1] == pytest.approx(60 / 40)


def test_stage_that_begins_again_counts_all_its_steps():
    shown: list[Progress] = []
    reporter = ProgressReporter(shown.append, [Stage(name="descent", steps=40, work=1.0, usual=20)])
    for step in (1, 2, 3, 1, 2):
        reporter(Progress(stage="descent", done=step, total=40))
    assert shown[-1].share == pytest.approx(5 / 20)
    assert [one.skipped for one in shown] == pytest.approx([0.0] * 5)


def test_steps_that_the_work_expects_take_the_place_of_the_planned_ones():
    shown: list[Progress] = []
    stages = [
        Stage(name="search", steps=100, work=1.0, usual=20),
        Stage(name="rest", steps=10, work=2.0, usual=5),
    ]
    reporter = ProgressReporter(shown.append, stages)
    reporter(Progress(stage="search", done=1, total=100))
    reporter(Progress(stage="search", done=2, total=100, expected={"search": 6, "rest": 1, "other": 9}))
    reporter(Progress(stage="search", done=3, total=100, expected={"search": 5}))
    reporter(Progress(stage="rest", done=1, total=10, expected={"rest": 0}))
    assert [1.0 - one.share for one in shown] == pytest.approx([29 / 30, 8 / 30, 7 / 30, 0.0])
    assert [one.skipped for one in shown] == pytest.approx([0.0, 20 / 30, 0.0, 5 / 30])


def test_parts_share_the_time_as_planned():
    shown: list[Progress] = []
    first, second = in_parts(shown.append, [30.0, 10.0])
    first(Progress(stage="a", done=1, total=2))
    second(Progress(stage="b", done=1, total=2))
    assert [one.share for one in shown] == [0.375, 0.875]
    assert [one.planned for one in shown] == [40.0, 40.0]


@st.composite
def uneven_work(draw):
    """Draw stages of very different length, of which some end early, and how long each of their steps takes.

    A step takes its work times a speed that differs by at most 1.25 either way from stage to stage.
    """
    stages, made = [], []
    for place in range(draw(st.integers(1, 5))):
        steps = draw(st.integers(20, 60))
        stages.append(Stage(name=f"stage {place}", steps=steps, work=draw(st.floats(0.01, 10.0))))
        made.append((draw(st.integers(1, steps)), draw(st.floats(0.8, 1.25))))
    return stages, made


@given(uneven_work(), st.floats(0.0, 100.0))
def test_time_left_is_within_a_factor_of_two_from_a_tenth_of_the_run_on(work, compiling):
    stages, made = work
    clock = Clock()
    pace = EtaEstimator(clock)
    shown: list[tuple[int, float, float | None]] = []

    def show(progress: Progress) -> None:
        left = pace.seconds_left(progress)
        shown.append((int(progress.stage[-1]), clock.now, left))

    # as part of longer work, of which nothing else takes time
    reporter = ProgressReporter(part_of(show, 0.0, 1.0), stages)
    clock.now += compiling
    for stage, (steps, speed) in zip(stages, made, strict=True):
        for step in range(1, steps + 1):
            clock.now += stage.work * speed
            reporter(Progress(stage=stage.name, done=step, total=stage.steps))
    reporter.end()
    end, begin = clock.now, shown[0][1]
    for place, now, left in shown[:-1]:
        rest = sum(  # nobody can know which stages will end early
            stage.work * speed * (stage.steps - steps)
            for stage, (steps, speed) in zip(stages[place:], made[place:], strict=True)
        )
        # 1 s: no estimate from less
        if now - begin > max(0.1 * (end + rest - begin), 1.0):
            assert left is not None
            assert 0.5 * (end + rest - now) <= left <= 2.0 * (end + rest - now)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0:00"), (59.6, "1:00"), (61.0, "1:01"), (3600.0, "1:00:00"), (36061, "10:01:01")],
)
def test_clock(seconds, text):
    assert as_clock(seconds) == text


#: starts two workers, shows their process numbers, and waits for work that takes a minute
WORK = """
import os, sys, time
from ballbot.processes import (uninterrupted, worker_pool)
pool = worker_pool(2)
with uninterrupted():
    pids = [pool.submit(os.getpid).result()]
    waiting = [pool.submit(time.sleep, 60.0) for _ in range(2)]
while len(pids) < 2:
    pids = list(pool._processes)
print(*pids, flush=True)
waiting[0].result()
"""


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"  # ended, and nobody has asked how


@pytest.mark.skipif(sys.platform != "linux", reason="looks processes up in /proc")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_when_their_parent_is_killed(how):
    with Child("-c", WORK) as parent:
        workers = [int(pid) for pid in parent.line().split()]
        assert len(workers) == 2
        assert all(map(alive, workers))
        parent.send(how)
        parent.end()
    deadline = time.monotonic() + PATIENCE
    while any(map(alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(map(alive, workers))
