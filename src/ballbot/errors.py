"""The one error that a user's input can raise, and what a sentence of it lists: choices, the nearest names."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches


class InputError(ValueError):
    """Bad input: a file, an option or an argument. Its text is one sentence and is all that the user is shown."""


@contextmanager
def about(what: object) -> Iterator[None]:
    """Begin the text of an InputError with what it is about, such as a file or a log's name; with "" as it is."""
    try:
        yield
    except InputError as error:
        raise (InputError(f"{what}: {error}") if what else error) from None


class CompiledCodeNotKept(UserWarning):
    """Numba has no folder for compiled code."""


class UnsuitedController(UserWarning):
    """A controller does not suit the robot that it is for; the text says why."""


def missing_package(what: str, package: str, *, extra: str) -> InputError:
    """Return the error of something that needs a package of one of Ballbot's extras: it says how to install it."""
    return InputError(f"{what} needs {package}; install it with: pip install 'ballbot[{extra}]'.")


def nearest(word: str, choices: Iterable[str], *, likeness: float = 0.6) -> list[str]:
    """Return the choice that is most like a misspelt word, at least so like it (the ratio of `difflib`), or none."""
    return get_close_matches(word, list(choices), n=1, cutoff=likeness)


def either(words: Iterable[str]) -> str:
    """Return words as a choice between them: a, b or c."""
    *others, last = words
    return f"{', '.join(others)} or {last}" if others else last


def every(words: Iterable[str]) -> str:
    """Return words as a list: a, b and c."""
    *others, last = words
    return f"{', '.join(others)} and {last}" if others else last


def suggest(
    word: str,  # what the user wrote
    choices: Iterable[str],  # what it could be
    *,
    otherwise: str,  # introduction of the list of all choices if none is near, such as "the names are"
) -> str:
    """Return the end of a sentence on an unknown word: did you mean 'square'?"""
    choices = list(choices)
    near = nearest(word, choices)
    return f"did you mean {near[0]!r}?" if near else f"{otherwise} {', '.join(choices)}."


def check_known(word: str, choices: Iterable[str], sentence: str, *, otherwise: str) -> None:
    """Raise InputError of a sentence, which ends as `suggest` says, unless a word is one of the choices."""
    choices = list(choices)
    if word not in choices:
        raise InputError(f"{sentence}; {suggest(word, choices, otherwise=otherwise)}")
