"""The types of what callers pass to public functions, checked in one place.

    @checked_arguments
    def simulate(plant: Plant | ModelLike, ..., *, duration: float, seed: int = 0) -> Log:

`simulate(..., duration="1")` is then refused by a sentence, before anything is done with it. What is checked are
numbers, classes, lists of them and functions, by the annotations. What has a check of its own that gives more advice,
such as arrays (`ballbot.arrays`), robots and logs, is left to that: see `_CHECKED_ELSEWHERE`.

Several names in one text, as of an option, are separated by `names_listed`.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache, wraps
from numbers import Real
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np

from ballbot.errors import InputError, either

P = ParamSpec("P")
T = TypeVar("T")

#: names in annotations of values that a function such as `as_robot` checks, with a sentence of its own
_CHECKED_ELSEWHERE = re.compile(
    r"\b(ArrayLike|NDArray|(Robot|Model|Log|Logs|Controller|Reference)Like|Controller|Linearizable|RobotLoop)\b"
)
_SEVERAL = (Sequence, Collection, Iterable)
_WORDS = {float: "a number", int: "a whole number", str: "a text", bool: "True or False"}


def names_listed(names: str) -> tuple[str, ...]:
    """Return names that stand with commas between."""
    return tuple(name.strip() for name in names.split(",") if name.strip())


def checked_arguments(function: Callable[P, T]) -> Callable[P, T]:
    """Give a public function the check of its arguments' types.

    It raises InputError if an argument is not of its annotation; see the module's text for what is checked.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError:  # Python's own sentence on a missing argument says it
            return function(*args, **kwargs)
        hints = _hints(function)
        for name in given.keys() & hints.keys():
            if not _fits(given[name], hints[name]):
                raise InputError(f"{name} is {_short(given[name])}; it must be {_described(hints[name])}.")
        return function(*args, **kwargs)

    return checked


@cache
def _hints(function: Callable[..., object]) -> Mapping[str, Any]:
    """Return the annotations to check, by the parameters' names."""
    found = {}
    for name, one in inspect.signature(function).parameters.items():
        text = one.annotation
        if not isinstance(text, str) or name == "self":
            continue
        if _CHECKED_ELSEWHERE.search(text) and not text.startswith("Sequence["):
            continue
        try:
            found[name] = eval(text, vars(sys.modules[function.__module__]))
        except NameError:  # imported for type checkers only
            continue
    return found


def _fits(value: object, hint: Any) -> bool:
    """Return whether a value is of an annotation; of one that cannot be checked, any is."""
    kind, inner = get_origin(hint), get_args(hint)
    if kind in (Union, UnionType):
        return any(_fits(value, one) for one in inner)
    if hint is None or hint is NoneType:
        return value is None
    if hint in (float, int):
        return _is_number(value, whole=hint is int)
    if kind in _SEVERAL:
        if isinstance(value, np.ndarray):
            return value.ndim > 0
        if isinstance(value, str | bytes) or not isinstance(value, kind):
            return False
        is_list = isinstance(value, list | tuple)
        return not is_list or inner[0] in (float, int) or all(_fits(one, inner[0]) for one in value)
    if kind is Literal:  # its function names the nearest choice
        return isinstance(value, str)
    if kind is tuple:  # a list does as well
        return isinstance(value, tuple | list | np.ndarray)
    if isinstance(kind, type) and kind is not type:
        return isinstance(value, kind)
    is_protocol = getattr(hint, "_is_protocol", False) and not getattr(hint, "_is_runtime_protocol", False)
    return isinstance(value, hint) if isinstance(hint, type) and not is_protocol else True


def _is_number(value: object, *, whole: bool) -> bool:
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool | np.bool_):
        return False
    return hasattr(value, "__index__") if whole else isinstance(value, Real)


def _described(hint: Any) -> str:
    kind, inner = get_origin(hint), get_args(hint)
    if kind in (Union, UnionType):
        return either([_described(one) for one in inner if one is not NoneType])
    if kind in _SEVERAL:
        what = getattr(inner[0], "__name__", "")
        return f"a list of {'texts' if inner[0] is str else what}".removesuffix(" of ")
    if kind is Literal:
        return either(map(repr, inner))
    if isinstance(kind, type):
        return "a dict" if issubclass(kind, Mapping) else "a function" if kind is Callable else kind.__name__
    return _WORDS.get(hint) or ("a path" if hint.__name__ == "Path" else f"a {hint.__name__}")


def _short(value: object) -> str:
    words = " ".join(repr(value).split())
    return words if len(words) <= 40 else f"an object of type {type(value).__name__}"
