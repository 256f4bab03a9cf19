"""The toolkit's source as syntax trees, parsed and walked once for every test that reads it."""

import ast
from functools import cache
from pathlib import Path

import ballbot

SOURCE = Path(ballbot.__file__).parent


@cache
def modules() -> dict[str, ast.Module]:
    """Return every module of the source by its dotted name."""
    found = {}
    for path in sorted(SOURCE.rglob("*.py")):
        parts = path.relative_to(SOURCE.parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = ast.parse(path.read_text(encoding="utf-8"))
    return found


@cache
def nodes_of(module: str) -> tuple[ast.AST, ...]:
    """Return every node of a module's tree."""
    return tuple(ast.walk(modules()[module]))
