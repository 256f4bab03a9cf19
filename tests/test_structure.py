"""The source's structure: packages import in one direction; functions and files have a readable size."""

import ast
import re
from collections import defaultdict
from functools import cache

from tests.support.paths import ROOT
from tests.support.schedule import ORDER
from tests.support.source import SOURCE, modules, nodes_of

#: a package may import those before it; what stands at the root of the source may be imported by all
PACKAGES = (
    "robot", "mechanics", "log", "estimation", "control", "simulation", "twin", "fitting",
    "identification", "validation", "vision", "workflows", "learning",
    "firmware", "link", "viewer", "report", "thesis", "cli",
)  # fmt: skip
LONGEST_BODY = 60
#: the decorators of compiled code
COMPILING = {"compiled", "compiled_alone", "inlined"}


@cache
def imports() -> dict[str, set[str]]:
    """Return which modules each module imports: at its top, in a function, for types only, or by name in a string.

    Its own packages, which Python imports before it, do not count.
    """
    found = defaultdict(set)
    for name in modules():
        for node in nodes_of(name):
            if isinstance(node, ast.ImportFrom) and node.module:
                wanted = {f"{node.module}.{alias.name}" for alias in node.names}
                found[name] |= {one if one in modules() else node.module for one in wanted}
            elif isinstance(node, ast.Import):
                found[name] |= {alias.name for alias in node.names}
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found[name] |= {node.value} if not name.startswith(f"{node.value}.") else set()
    return {
        name: {one for one in wanted if one in modules() and one != name} for name, wanted in found.items()
    }


def functions() -> list[tuple[str, ast.FunctionDef]]:
    """Return every function with the name of its module."""
    return [
        (name, node) for name in modules() for node in nodes_of(name) if isinstance(node, ast.FunctionDef)
    ]


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Return the names along one circle of imports; empty without a circle."""
    done: set[str] = set()

    def walk(name: str, path: list[str]) -> list[str]:
        if name in path:
            return [*path[path.index(name) :], name]
        if name in done:
            return []
        for other in sorted(graph.get(name, ())):
            found = walk(other, [*path, name])
            if found:
                return found
        done.add(name)
        return []

    return next((found for name in sorted(graph) if (found := walk(name, []))), [])


def test_a_circle_is_found_where_there_is_one():
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert circle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_collecting_tests_runs_no_compiled_code(run_at_collection):
    """Every worker collects every test: what it compiles then is compiled once for each worker."""
    assert run_at_collection == []


def test_files_that_tests_are_ordered_by_exist():
    folders = ROOT / "tests", ROOT / "campaigns" / "tests"
    files = [path.relative_to(ROOT).as_posix() for folder in folders for path in folder.rglob("test_*.py")]
    for names in ORDER:
        for name in (names,) if isinstance(names, str) else names:
            assert any(file.startswith(name) for file in files), name


def test_no_module_imports_itself_through_others():
    # the lazy names of the toolkit's front page point down into the packages; they are no import of that page's
    found = circle({name: wanted for name, wanted in imports().items() if name != "ballbot"})
    assert not found, " imports ".join(found)


def test_a_package_imports_only_those_before_it():
    rank = {package: number for number, package in enumerate(PACKAGES)}
    against = []
    for name, wanted in imports().items():
        for other in wanted:
            here, there = (one.split(".")[1] if "." in one else "" for one in (name, other))
            if rank.get(here, -1) < rank.get(there, -1) and name not in (
                "ballbot",
                "ballbot.__main__",
                "ballbot.gym",
            ):
                against.append(f"{name} imports {other}")
    assert against == []


def test_modules_are_imported_by_a_computed_name_only_within_their_package():
    """The front page's names are in strings, which `imports` sees; those of commands and presets are their files'."""
    importing = {
        module
        for module in modules()
        for node in nodes_of(module)
        if isinstance(node, ast.Name | ast.Attribute)
        and ast.unparse(node).rpartition(".")[2] in ("import_module", "__import__")
    }
    assert importing == {"ballbot", "ballbot.cli.app", "ballbot.cli.completion", "ballbot.control.presets"}


def test_every_package_has_its_place_in_the_order():
    found = {path.name for path in SOURCE.iterdir() if (path / "__init__.py").is_file()}
    assert found == set(PACKAGES)


def test_functions_are_short():
    too_long = []
    for module, function in functions():
        body = function.body[1:] if ast.get_docstring(function) is not None else function.body
        if body and (body[-1].end_lineno or 0) - body[0].lineno + 1 > LONGEST_BODY:
            too_long.append(f"{module}.{function.name}")
    assert too_long == []


def test_compiled_code_copies_arrays_number_by_number():
    """An array assigned to a slice brings the text of its errors, which takes seconds to compile: `fill` does not."""
    assigned = []
    for module, function in functions():
        if {ast.unparse(one).partition("(")[0] for one in function.decorator_list} & COMPILING:
            for node in ast.walk(function):
                targets = node.targets if isinstance(node, ast.Assign) else []
                targets = [node.target] if isinstance(node, ast.AugAssign) else targets
                for target in targets:
                    if isinstance(target, ast.Subscript) and any(
                        isinstance(part, ast.Slice) for part in ast.walk(target.slice)
                    ):
                        assigned.append(f"{module}:{node.lineno} {ast.unparse(target)}")
    assert assigned == []


def names_at_top(module: str) -> set[str]:
    """Return the names that a module defines or imports."""
    found = {one.removeprefix(f"{module}.") for one in modules() if one.startswith(f"{module}.")}
    for node in nodes_of(module):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
    return found


def test_tests_import_no_campaign():
    texts = {path: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py")}
    assert [
        path.name for path, text in texts.items() if re.search(r"^\s*(from|import) campaigns\b", text, re.M)
    ] == []


def test_what_benchmarks_campaigns_and_examples_import_exists():
    """No type checker reads them, and benchmarks run for minutes and in no test."""
    missing = [
        f"{path.relative_to(ROOT)}: {node.module}.{alias.name}"
        for folder in ("benchmarks", "campaigns", "examples")
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module in modules() and node.module != "ballbot"
        for alias in node.names
        if alias.name not in names_at_top(node.module)
    ]
    assert not missing
