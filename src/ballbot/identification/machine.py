"""What the last bits of a result depend on besides its inputs: versions, and the processor code is compiled for."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version

from llvmlite.binding import get_host_cpu_name
from numba.core.registry import cpu_target

_PACKAGES = ("ballbot", "numpy", "scipy", "numba", "cmaes")


@cache
def machine() -> dict[str, str]:
    """Return the versions and the processor's kind, each by a plain name.

    In brackets stands a digest of the instructions that Numba compiles to.
    """
    _, _, features = cpu_target.target_context.codegen().magic_tuple()  # pyright: ignore[reportAttributeAccessIssue]
    compiled_for = hashlib.sha256(features.encode()).hexdigest()[:8]
    kind = f"{get_host_cpu_name()} ({compiled_for})"
    return {package: version(package) for package in _PACKAGES} | {"processor": kind}
