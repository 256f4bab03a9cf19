"""Checkpoints: a search that is stopped anywhere goes on bit for bit, and a file of another run is refused."""

import json
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ballbot.errors import InputError
from ballbot.fitting.checkpoint import open_checkpoint
from ballbot.fitting.run import Memory, Run
from ballbot.fitting.search import SearchResult, evolve
from ballbot.progress import Progress

INPUTS = {"robot": "alten", "seed": "7"}


class StoppedError(Exception):
    """What ends a run on the way."""


def check_progress(progress: Progress) -> None:
    assert progress.done > 0
    assert progress.cost > 0.0


def valley(points: np.ndarray) -> np.ndarray:
    """Return a bent valley's costs, whose bits depend on every coordinate."""
    x, y, z = 4.0 * points.T - 2.0
    return (1.0 - x) ** 2 + 10.0 * (y - x**2) ** 2 + np.exp(np.sin(z))


def search(checkpoint: Memory | None, *, answers: float = np.inf) -> SearchResult:
    """Run a search that ends by itself, or with `StoppedError` once it has computed so many answers."""
    computed = 0

    def cost_of(points: np.ndarray) -> np.ndarray:
        nonlocal computed
        computed += 1
        if computed > answers:
            raise StoppedError
        return valley(points)

    run = Run(seed=7, checkpoint=checkpoint, progress=check_progress)
    return evolve(cost_of, size=3, generations=15, population=6, run=run)


def begin(path: Path, *, resume: bool = False, inputs: dict[str, str] = INPUTS) -> Memory:
    return open_checkpoint(path, belongs_to=inputs, resume=resume)


@given(stops=st.lists(st.integers(0, 6), max_size=4))
@settings(deadline=None, max_examples=30)
def test_a_search_stopped_anywhere_and_resumed_ends_in_the_same_bits(tmp_path_factory, stops):
    path = tmp_path_factory.mktemp("run") / "checkpoint.jsonl"
    never_stopped = search(None)
    for stop in stops:
        with suppress(StoppedError):
            search(begin(path, resume=True), answers=stop)
    resumed = search(begin(path, resume=True))
    assert resumed.best.tobytes() == never_stopped.best.tobytes()
    assert resumed.history == never_stopped.history


def test_stored_results_are_not_recomputed(tmp_path):
    path = tmp_path / "checkpoint.jsonl"
    with pytest.raises(StoppedError):
        search(begin(path), answers=10)
    search(begin(path, resume=True), answers=5)  # 15 generations in all
    with pytest.raises(StoppedError):
        search(begin(path.with_name("other"), resume=True), answers=5)
    search(begin(path, resume=True), answers=0)


@given(
    question=arrays(float, (2, 3), elements=st.floats(width=64)),
    answer=arrays(float, st.sampled_from([(4,), (0, 3), (2, 1, 2), ()]), elements=st.floats(width=64)),
)
@settings(deadline=None, max_examples=50)
def test_every_float_comes_back_from_the_file(tmp_path_factory, question, answer):
    path = tmp_path_factory.mktemp("run") / "checkpoint.jsonl"
    begin(path).memoize("stage", question, lambda: [answer])
    (back,) = begin(path, resume=True).memoize("stage", question, never)
    assert back.shape == answer.shape
    np.testing.assert_array_equal(back, answer)
    np.testing.assert_array_equal(np.signbit(back[~np.isnan(back)]), np.signbit(answer[~np.isnan(answer)]))


def never() -> list[np.ndarray]:
    raise AssertionError("computed again")


def test_nothing_is_written_before_there_is_an_answer(tmp_path):
    path = tmp_path / "checkpoint.jsonl"
    with pytest.raises(StoppedError):
        search(begin(path), answers=0)
    assert not path.exists()


def test_run_without_a_checkpoint_starts_from_the_beginning(tmp_path):
    assert search(begin(tmp_path / "checkpoint.jsonl", resume=True)).history == search(None).history


def test_an_unfinished_run_is_not_overwritten(tmp_path):
    path = tmp_path / "checkpoint.jsonl"
    begin(path).memoize("stage", np.ones(3), list)
    with pytest.raises(InputError, match="a run that was not finished; resume it"):
        begin(path)


def test_checkpoint_of_another_run_is_refused_with_the_difference(tmp_path):
    path = tmp_path / "checkpoint.jsonl"
    begin(path).memoize("stage", np.ones(3), list)
    with pytest.raises(InputError, match="another run, which differs in: seed;"):
        begin(path, resume=True, inputs=INPUTS | {"seed": "8"})
    with pytest.raises(InputError, match="another run, which differs in: window;"):
        begin(path, resume=True, inputs=INPUTS | {"window": "0.5"})


def cut(text: str) -> str:
    return text[: len(text) - 40]


def other_format(text: str) -> str:
    return text.replace("ballbot checkpoint 4", "ballbot checkpoint 2")


def changed_digit(text: str) -> str:
    """Change the first decimal of the last answer that has one."""
    place = text.rindex("0.", 0, text.rindex('"sha256"')) + 2
    return text[:place] + ("3" if text[place] != "3" else "9") + text[place + 1 :]


def without_line(number: int) -> Callable[[str], str]:
    return lambda text: "".join(line for i, line in enumerate(text.splitlines(keepends=True)) if i != number)


def lines_swapped(text: str) -> str:
    header, first, second, *rest = text.splitlines(keepends=True)
    return "".join((header, second, first, *rest))


def other_seed(text: str) -> str:
    return text.replace('"seed": "7"', '"seed": "8"')


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda _: "", "is not a complete checkpoint"),
        (lambda _: "t,x\n1,2\n", "is not a complete checkpoint"),
        (lambda _: "[]\n", "is not a complete checkpoint"),
        (
            other_format,
            r"is a checkpoint of format 2, and Ballbot \S+ has format 4; resume it with the version",
        ),
        (cut, "is not a complete checkpoint"),
        (lambda _: "[" * 100_000, "is not a complete checkpoint"),
        (other_seed, "was edited at line 1;"),
        (lambda text: text.replace('"answer"', '"reply"'), "was edited at line 2;"),
        (lambda text: text.replace("evolution", "polish"), "was edited at line 2;"),
        (without_line(1), "was edited at line 2;"),
        (without_line(5), "was edited at line 6;"),
        (lines_swapped, "was edited at line 2;"),
        (changed_digit, "was edited at line 16;"),
    ],
)
def test_damaged_checkpoint_is_refused_in_one_sentence(tmp_path, spoil: Callable[[str], str], sentence: str):
    path = tmp_path / "checkpoint.jsonl"
    search(begin(path))
    path.write_text(spoil(path.read_text()))
    with pytest.raises(InputError, match=sentence):
        begin(path, resume=True)


@given(data=st.data())
@settings(deadline=None, max_examples=50)
def test_any_changed_byte_is_detected(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("run") / "checkpoint.jsonl"
    with suppress(StoppedError):
        search(begin(path), answers=2)
    written = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(written) - 1))
    written[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(written)
    with pytest.raises(InputError, match="delete it to start again"):
        begin(path, resume=True)


def test_checkpoint_of_other_inputs_is_refused(tmp_path):
    path = tmp_path / "checkpoint.jsonl"
    begin(path).memoize("evolution", np.ones(3), list)
    with pytest.raises(InputError, match="the run differs"):
        begin(path, resume=True).memoize("polish", np.ones(3), never)


@pytest.mark.parametrize("kind", ["folder", "pipe"])
def test_only_an_existing_checkpoint_is_resumed(tmp_path, kind):
    path = tmp_path / "checkpoint.jsonl"
    path.mkdir() if kind == "folder" else os.mkfifo(path)
    with pytest.raises(InputError, match=f"is a {kind}; a file is needed"):
        begin(path, resume=True)


def test_inputs_differing_by_one_bit_are_refused(tmp_path):
    path = tmp_path / "checkpoint.jsonl"
    begin(path).memoize("stage", np.ones(3), lambda: [np.zeros(1)])
    with pytest.raises(InputError, match="from line 2 on the run differs"):
        begin(path, resume=True).memoize("stage", np.array([1.0, 1.0, np.nextafter(1.0, 2.0)]), never)


def test_the_file_is_text_that_a_person_can_read(tmp_path):
    path = tmp_path / "checkpoint.jsonl"
    search(begin(path))
    header, first, *rest = (json.loads(line) for line in path.read_text().splitlines())
    assert header["belongs_to"] == INPUTS
    assert first["stage"] == "evolution"
    assert np.shape(first["question"]["values"]) == (18,)
    assert len(rest) == 14


def test_removing_takes_what_a_killed_write_left_behind(tmp_path):
    checkpoint = open_checkpoint(tmp_path / "checkpoint.jsonl", belongs_to=INPUTS, resume=False)
    checkpoint.memoize("stage", np.ones(3), list)
    (tmp_path / ".checkpoint.jsonl.x8d2").write_text("a part")
    (tmp_path / "results.json").write_text("{}")
    checkpoint.remove()
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]


def test_unwritable_folder_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        begin(tmp_path / "file" / "checkpoint.jsonl")("stage", np.ones(3), list)
