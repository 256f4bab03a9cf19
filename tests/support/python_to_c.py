"""The law and its parts as C: their compiled Python, statement by statement, in single precision.

`Program.add` takes a function of Python and the types it is called with, `Program.sources` gives a file's text.

The functions are the restricted Python that Numba compiles: numbers, records (`ballbot.records`), named tuples
and loops. A function becomes one of C with its name, comments, branches and loops, a record's field a member of its
struct, a named tuple a struct by value (by address with more than `_LARGEST_VALUE` numbers), a module's constant a
macro. Types follow from the calls, as for Numba: a function that is called with two sets of them is refused, as is
whatever has no counterpart in C, with file, line and construct. Nothing is allocated.

This is a tool of development, like the headers' (`tests.support.firmware_headers`, which writes the files): whoever
installs Ballbot gets the C that it wrote.
"""

from __future__ import annotations

import ast
import inspect
import io
import math
import re
import sys
import tokenize
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import get_type_hints

import numpy as np

from ballbot.control.friction_table import SPEEDS
from ballbot.control.parts.part import MAX_PAST
from ballbot.errors import InputError
from ballbot.firmware.header import struct_name
from ballbot.records import MAX_WHEELS, Number, Schema

#: numbers in a named tuple that is passed by value
_LARGEST_VALUE = 5
_COLUMNS = 118
#: how tightly operators bind
_CHOICE, _OR, _AND, _COMPARED, _SUM, _PRODUCT, _SIGN, _ATOM = range(8)
_OPERATORS = {ast.Add: ("+", _SUM), ast.Sub: ("-", _SUM), ast.Mult: ("*", _PRODUCT), ast.Div: ("/", _PRODUCT),
              ast.FloorDiv: ("/", _PRODUCT)}  # fmt: skip
_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
#: lengths that have a name in C
_NAMED_LENGTHS = {
    MAX_WHEELS: "BALLBOT_MAX_WHEELS",
    MAX_PAST: "BALLBOT_MAX_PAST",
    SPEEDS: "BALLBOT_TABLE_SPEEDS",
}
#: comments for Python's tools
_NOT_FOR_READERS = re.compile(r"noqa|pyright|fmt:|type:")


@dataclass(frozen=True)
class Type:
    """A type of C: a number, a struct, or an array of either."""

    name: str
    shape: tuple[str, ...] = ()  #: lengths of an array
    members: Schema | type | None = None  #: a struct's: a record, or a named tuple

    @property
    def by_address(self) -> bool:
        """Whether a function gets the address of such an argument."""
        return bool(self.shape) or isinstance(self.members, Schema) or _size(self.members) > _LARGEST_VALUE

    def takes(self, given: Type) -> bool:
        """Return whether an argument of a type is one of this type; an array's first length may be left open."""
        is_open = self.shape[:1] == ("",) and given.shape
        return self == (replace(given, shape=("", *given.shape[1:])) if is_open else given)

    def declared(self, name: str) -> str:
        """Return a declaration of a parameter or of an alias; an array's first length may be left out."""
        if self.shape:
            lengths = "".join(f"[{length}]" for length in self.shape)
            return f"{self.name} {name}{lengths}"
        return f"{self.name} {'*' if self.by_address else ''}{name}"

    def alias(self, name: str) -> str:
        """Return a declaration of a pointer to such a thing."""
        inner = "".join(f"[{length}]" for length in self.shape[1:])
        return f"{self.name} {f'(*{name}){inner}' if inner else f'*{name}'}"


REAL, WHOLE, TRUTH, NOTHING = Type("float"), Type("int32_t"), Type("bool"), Type("void")
_SCALARS = {float: REAL, int: WHOLE, bool: TRUTH}


def record(schema: Schema) -> Type:
    """Return the type of a record's struct."""
    return Type(f"struct {struct_name(schema)}", (), schema)


def values(kind: type) -> Type:
    """Return the type of a named tuple's struct, whose name is that of the class."""
    plain = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", kind.__name__.lstrip("_")).lower()
    return Type(f"struct {plain if kind.__name__.startswith('_') else f'ballbot_{plain}'}", (), kind)


def _member_types(kind: type) -> dict[str, Type]:
    """Return the types of a named tuple's fields."""
    return {name: _SCALARS.get(hint) or values(hint) for name, hint in get_type_hints(kind).items()}


def _size(members: Schema | type | None) -> int:
    """Return the numbers in a named tuple."""
    if not isinstance(members, type):
        return 1
    return sum(_size(one.members) for one in _member_types(members).values())


def lengths(shape: tuple[int, ...]) -> tuple[str, ...]:
    """Return an array's lengths, the first ones by name: updates, then wheels."""
    named = [str(size) for size in shape]
    for axis, size in enumerate(shape):
        if size not in _NAMED_LENGTHS:
            break
        named[axis] = _NAMED_LENGTHS[size]
    return tuple(named)


@dataclass(frozen=True)
class External:
    """A function that C has by hand; `outputs` says that it fills two numbers, instead of returning them."""

    name: str  #: or an expression with places for the arguments
    result: Type = REAL
    written: tuple[int, ...] = ()  #: arguments through whose address it writes
    outputs: bool = False


@dataclass
class Function:
    """A function of C."""

    name: str
    module: ModuleType
    comment: str
    parameters: dict[str, Type]
    result: Type = NOTHING
    written: set[str] = field(default_factory=set)  #: parameters through whose address it writes
    body: list[str] = field(default_factory=list)

    @property
    def head(self) -> str:
        """Its declaration without a semicolon."""
        given = [
            f"{'const ' if one.by_address and name not in self.written else ''}{one.declared(name)}"
            for name, one in self.parameters.items()
            if one != NOTHING
        ]
        return f"{self.result.name} {self.name}({', '.join(given) or 'void'})"


@dataclass(frozen=True)
class _Text:
    """An expression of C."""

    text: str
    type: Type
    level: int = _ATOM
    root: str = ""  #: the variable in whose memory it is
    address: bool = False  #: whether it is the address of a struct

    def within(self, level: int) -> str:
        """Return it as an operand of an operator that binds so tightly."""
        return f"({self.text})" if self.level < level else self.text


@dataclass
class _Variable:
    type: Type
    root: str  #: the parameter, or this variable, whose memory it stands for
    address: bool = False
    written: bool = False


@dataclass(frozen=True, eq=False)
class _Source:
    """A module's text and syntax tree."""

    module: ModuleType
    path: Path
    functions: Mapping[str, ast.FunctionDef]
    comments: Mapping[int, tuple[str, bool]]  #: by line: text, and whether it stands alone


@cache
def _source_of(module: ModuleType) -> _Source:
    text = inspect.getsource(module)
    tree = ast.parse(text)
    comments: dict[int, tuple[str, bool]] = {}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        words = token.string.lstrip("#: ")
        if token.type == tokenize.COMMENT and not _NOT_FOR_READERS.match(words):
            comments[token.start[0]] = (words, token.line.strip().startswith("#"))
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    return _Source(module, Path(inspect.getfile(module)), functions, comments)


class Program:
    """Functions of Python as C, from the types that they are called with; what they call comes with them."""

    def __init__(self, *, externals: Mapping[object, External], names: Mapping[str, str]) -> None:
        self.externals = externals  #: by the function of Python
        self.names = names  #: what C has by hand, by the name in Python: constants
        self.functions: dict[object, Function] = {}
        self.constants: dict[ModuleType, dict[str, str]] = {}
        self.structs: dict[ModuleType, dict[type, str]] = {}

    def add(self, function: Callable, parameters: Sequence[Type]) -> Function:
        """Return the C of a function that is called with such arguments."""
        plain = getattr(function, "py_func", function)
        if plain not in self.functions:
            module = sys.modules[plain.__module__]
            node = _source_of(module).functions[plain.__name__]
            names = [one.arg for one in node.args.args]
            made = _Body(self, _source_of(module), node, dict(zip(names, parameters, strict=True))).function
            self.functions[plain] = made
        return self.functions[plain]

    def struct(self, kind: type) -> Type:
        """Return the type of a named tuple, whose struct is declared by the module that it is of."""
        found = values(kind)
        here = self.structs.setdefault(sys.modules[kind.__module__], {})
        if kind not in here:
            members = _member_types(kind)
            for one in members.values():
                if isinstance(one.members, type):
                    self.struct(one.members)
            lines = [f"    {one.name} {name};{_field_comment(kind, name)}\n" for name, one in members.items()]
            here[kind] = f"{_comment(kind.__doc__ or '')}{found.name} {{\n{''.join(lines)}}};\n"
        return found

    def sources(self, module: ModuleType, *, inline: bool = False) -> str:
        """Return what a file has of a module's functions: constants, structs, and functions in order of calls.

        An `inline` one is a header that has all of the module.
        """
        constants, structs = self.constants.get(module, {}), self.structs.get(module, {})
        own = [text for kind, text in structs.items() if inline or kind.__name__.startswith("_")]
        public = "static inline " if inline else ""
        bodies = [
            f"{one.comment}{_wrapped((public if one.name.startswith('ballbot_') else 'static ') + one.head)}\n{{\n"
            + "".join(f"{line}\n" for line in one.body)
            + "}\n"
            for one in self.functions.values()
            if one.module is module
        ]
        return "\n".join([*filter(None, ["".join(constants.values())]), *own, *bodies])

    def declarations(self, module: ModuleType) -> str:
        """Return what a header has of a module: structs of public named tuples, and public functions."""
        structs = [
            text for kind, text in self.structs.get(module, {}).items() if not kind.__name__.startswith("_")
        ]
        heads = [
            f"{one.comment}{_wrapped(one.head)};\n"
            for one in self.functions.values()
            if one.module is module and one.name.startswith("ballbot_")
        ]
        return "\n".join([*structs, *heads])


def _comment(text: str, indent: str = "") -> str:
    """Return a docstring as a comment of C."""
    plain = re.sub(r"`_?([^`]*)`", r"\1", inspect.cleandoc(text)).replace("*/", "* /").replace("/*", "/ *")
    if "\n" not in plain:
        return "".join(f"{line}\n" for line in _fold(f"/* {plain} */", indent, " * "))
    lines = [f" * {line}".rstrip() for line in plain.split("\n")]
    return "\n".join(
        [f"{indent}/*{lines[0][2:]}", *(f"{indent}{line}" for line in lines[1:]), f"{indent} */", ""]
    )


def _field_comment(kind: type, name: str) -> str:
    source = _source_of(sys.modules[kind.__module__])
    text = inspect.getsource(sys.modules[kind.__module__]).split("\n")
    begin = next(i for i, line in enumerate(text) if re.match(rf"class {kind.__name__}\b", line))
    line = next(i for i in range(begin, len(text)) if re.match(rf"    {name}:", text[i])) + 1
    return f" /* {source.comments[line][0]} */" if line in source.comments else ""


def _fold(text: str, indent: str, more: str = "        ") -> list[str]:
    """Return a line, broken after a comma or before an operator if it is too long."""
    lines = []
    comment = text.startswith("/*")
    while len(indent) + len(text) > _COLUMNS:
        breaks = [
            [found.end() for found in re.finditer(signs, text[: _COLUMNS - len(indent)])]
            for signs in ([r" "] if comment else [r", ", r" (?=(?:&&|\|\||[-+?:]) )", r" (?=[*/] )|= ", r" "])
        ]
        at = next((places[-1] for places in breaks if places and places[-1] > 40), len(text))
        lines.append(f"{indent}{text[:at].rstrip()}")
        text, indent = text[at:], f"{indent}{more}" if not lines[1:] else indent
        if not text:
            return lines
    return [*lines, f"{indent}{text}"]


def _wrapped(text: str) -> str:
    return "\n".join(_fold(text, ""))


class _Body:
    """Translates one function; `function` is the result."""

    def __init__(
        self, program: Program, source: _Source, node: ast.FunctionDef, parameters: dict[str, Type]
    ) -> None:
        self.program, self.source, self.node = program, source, node
        name = node.name.lstrip("_") if node.name.startswith("_") else f"ballbot_{node.name}"
        self.function = Function(name, source.module, _comment(ast.get_docstring(node) or name), parameters)
        self.variables = {
            name: _Variable(kind, name, address=kind.by_address and not kind.shape)
            for name, kind in parameters.items()
        }
        self.line = node.body[0].lineno  # up to which comments are written
        self.assigned = [
            one.id for one in ast.walk(node) if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)
        ]
        lines = self._block(node.body, "    ")
        for name, variable in self.variables.items():
            if variable.written and name in parameters:
                self.function.written.add(name)
        written = {name for name, variable in self.variables.items() if variable.written}
        self.function.body = [
            folded
            for line in lines
            for folded in self._finished(
                re.sub(r"@(\w+)@", lambda m: "" if m[1] in written else "const ", line)
            )
        ]

    @staticmethod
    def _finished(line: str) -> list[str]:
        indent = line[: len(line) - len(line.lstrip())]
        more = " * " if line.lstrip().startswith("/*") else "    "
        return _fold(line.strip(), indent, more) or [""]

    def _refuse(self, node: ast.AST, why: str = "") -> InputError:
        line = getattr(node, "lineno", self.node.lineno)
        written = ast.unparse(node).split("\n")[0]
        return InputError(
            f"{self.source.path}:{line}: {written!r} has no counterpart in C{why and f': {why}'}."
        )

    # --- statements ---

    def _block(self, statements: Sequence[ast.stmt], indent: str) -> list[str]:
        """Return the lines of a block; a blank one follows its declarations."""
        lines: list[str] = []
        declares = False
        for statement in statements:
            if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                continue  # a docstring
            lines += self._comments_before(statement, indent)
            made = [f"{indent}{line}" if line else "" for line in self._statement(statement, indent)]
            is_declaration = self._declares
            if declares and not is_declaration:
                lines.append("")
            declares = is_declaration
            trailing = self.source.comments.get(statement.lineno)
            if trailing and not trailing[1] and len(made) and not isinstance(statement, ast.If):
                made[-1] += f" /* {trailing[0]} */"
            lines += made
            self.line = max(self.line, statement.end_lineno or 0)
        return lines

    def _comments_before(self, statement: ast.stmt, indent: str) -> list[str]:
        found = [self.source.comments.get(line) for line in range(self.line, statement.lineno)]
        self.line = statement.lineno
        words = " ".join(text for text, alone in filter(None, found) if alone)
        return [f"{indent}/* {words} */"] if words else []

    def _statement(self, node: ast.stmt, indent: str) -> list[str]:
        self._declares = False
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=given)):
                names = [one.id for one in targets if isinstance(one, ast.Name)]
                later = {
                    one.id for value in given[1:] for one in ast.walk(value) if isinstance(one, ast.Name)
                }
                if later & set(names):
                    raise self._refuse(node, "a value depends on a name that is assigned before it")
                return [
                    self._assign(target, self._value(value))
                    for target, value in zip(targets, given, strict=True)
                ]
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Call(func=called, args=args)):
                return self._outputs(node, targets, called, args)
            case ast.Assign(targets=targets, value=value):
                made = self._value(value)
                return [self._assign(target, made) for target in targets]
            case ast.AugAssign(target=target, op=op, value=value) if type(op) in _OPERATORS:
                self._mark_written(target)
                to, made = self._value(_loaded(target)), self._value(value)
                return [f"{to.text} {_OPERATORS[type(op)][0]}= {self._as(to.type, made)};"]
            case ast.If(test=test, body=body, orelse=orelse):
                lines = [f"if ({self._value(test).text}) {{", *self._inner(body, indent)]
                if len(orelse) == 1 and isinstance(orelse[0], ast.If):
                    first, *more = self._statement(orelse[0], indent)
                    self._declares = False
                    return [*lines, f"}} else {first}", *more]
                if orelse:
                    lines += ["} else {", *self._inner(orelse, indent)]
                self._declares = False
                return [*lines, "}"]
            case ast.While(test=test, body=body, orelse=[]):
                lines = [f"while ({self._value(test).text}) {{", *self._inner(body, indent), "}"]
                self._declares = False
                return lines
            case ast.For(target=ast.Name(id=name), iter=iterated, body=body, orelse=[]):
                lines = [*self._loop(name, iterated), *self._inner(body, indent), "}"]
                self._declares = False
                return lines
            case ast.Return(value=None):
                return ["return;"]
            case ast.Return(value=value) if value is not None:
                made = self._value(value)
                self._result(node, made.type)
                return [f"return {self._as(made.type, made)};"]
            case ast.Expr(value=ast.Call() as call):
                made = self._value(call)
                return [f"{'' if made.type == NOTHING else '(void)'}{made.text};"]
            case ast.Continue():
                return ["continue;"]
        raise self._refuse(node)

    def _inner(self, body: Sequence[ast.stmt], indent: str) -> list[str]:
        """Return the lines of an inner block, indented against the statement that it belongs to."""
        lines = self._block(body, f"{indent}    ")
        return [line.removeprefix(indent) for line in lines]

    def _result(self, node: ast.AST, found: Type) -> None:
        if self.function.result == NOTHING:
            self.function.result = found
        elif self.function.result != found:
            raise self._refuse(
                node, f"another return gives {self.function.result.name}, this one {found.name}"
            )

    def _outputs(
        self, node: ast.Assign, targets: Sequence[ast.expr], called: ast.expr, args: Sequence[ast.expr]
    ) -> list[str]:
        """Return a call of a function that fills numbers."""
        external = self.program.externals.get(getattr(self.source.module, ast.unparse(called), None))
        if external is None or not external.outputs:
            raise self._refuse(node, "a function returns one value; a named tuple has several")
        names = [ast.unparse(one) for one in targets]
        for name in names:
            self.variables[name] = _Variable(REAL, name, written=True)
        self._declares = True
        given = ", ".join([*(self._value(one).text for one in args), *(f"&{name}" for name in names)])
        return [*(f"float {name};" for name in names), "", f"{external.name}({given});"]

    def _loop(self, name: str, iterated: ast.expr) -> list[str]:
        self.variables[name] = _Variable(WHOLE, name)
        match iterated:
            case ast.Call(func=ast.Name(id="range"), args=args):
                given = [self._value(one).text for one in args]
                first, last = ("0", given[0]) if len(given) == 1 else given[:2]
                sign, step = (">", "--") if given[2:] == ["-1"] else ("<", "++")
                if given[2:] not in ([], ["-1"]):
                    raise self._refuse(iterated, "a loop steps by 1 or by -1")
                return [f"for (int32_t {name} = {first}; {name} {sign} {last}; {step}{name}) {{"]
        raise self._refuse(iterated)

    def _assign(self, target: ast.expr, made: _Text) -> str:
        if isinstance(target, ast.Name):
            return self._assign_name(target, made)
        self._mark_written(target)
        to = self._value(_loaded(target))
        return f"{to.text} = {self._as(to.type, made)};"

    def _assign_name(self, target: ast.Name, made: _Text) -> str:
        name = target.id
        if name in self.variables:
            variable = self.variables[name]
            if variable.address or variable.type.shape or variable.type != made.type:
                raise self._refuse(target, "a name keeps its type, and stands for one record or array")
            variable.written = True
            return f"{name} = {made.text};"
        self._declares = True
        kind = made.type
        if kind.shape or isinstance(kind.members, Schema):
            # a record or an array is not copied: its address is taken
            root = self.variables[made.root].root if made.root else name
            self.variables[name] = _Variable(kind, root, address=not kind.shape)
            taken = made.text if kind.shape or made.address else f"&{made.text}"
            return f"@{name}@{kind.alias(name)} = {taken};"
        if any(
            one.name == name and one.module is self.source.module for one in self.program.functions.values()
        ):
            raise self._refuse(target, "a function has this name")
        self.variables[name] = _Variable(kind, name, written=self.assigned.count(name) > 1)
        return f"@{name}@{kind.name} {name} = {self._as(kind, made).removeprefix(f'({kind.name})')};"

    def _mark_written(self, target: ast.expr) -> None:
        """Note which variables an assignment changes, or through which it writes."""
        if isinstance(target, ast.Name) and target.id in self.variables:
            self.variables[target.id].written = True
            return
        self._note(self._value(_loaded(target)).root, target)

    def _note(self, root: str, node: ast.AST) -> None:
        while root:
            variable = self.variables[root]
            if not (variable.address or variable.type.shape):
                raise self._refuse(node, "a named tuple does not change")
            variable.written = True
            root = variable.root if variable.root != root else ""

    # --- expressions ---

    def _as(self, kind: Type, made: _Text) -> str:
        """Return a value where one of a type is wanted."""
        if made.address:
            return f"*{made.text}"
        if kind == REAL and made.type == WHOLE:
            return f"{made.text}.0f" if made.text.isdigit() else f"(float){made.within(_SIGN)}"
        return made.text

    def _value(self, node: ast.expr) -> _Text:
        match node:
            case ast.Constant(value=bool() as truth):
                return _Text(str(truth).lower(), TRUTH)
            case ast.Constant(value=int() as number):
                return _Text(str(number), WHOLE)
            case ast.Constant(value=float() as number):
                return _Text(f"{number!r}f", REAL)
            case ast.Name(id=name):
                return self._name(node, name)
            case ast.Attribute(value=value, attr=name):
                return self._member(node, self._value(value), name)
            case ast.Subscript(value=value, slice=index):
                return self._entry(
                    node, self._value(value), index.elts if isinstance(index, ast.Tuple) else [index]
                )
            case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=0.5)):
                return _Text(f"ballbot_square_root({self._value(left).text})", REAL)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return self._operation(node, self._value(left), self._value(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                made = self._value(operand)
                return _Text(f"-{made.within(_SIGN)}", made.type, _SIGN)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return _Text(f"!{self._value(operand).within(_SIGN)}", TRUTH, _SIGN)
            case ast.BoolOp(op=op, values=operands):
                sign, level = ("&&", _AND) if isinstance(op, ast.And) else ("||", _OR)
                return _Text(
                    f" {sign} ".join(self._value(one).within(_COMPARED) for one in operands), TRUTH, level
                )
            case ast.Compare(left=left, ops=ops, comparators=others):
                sides = [self._value(one) for one in (left, *others)]
                pairs = [
                    self._compared(node, a, op, b) for a, op, b in zip(sides, ops, sides[1:], strict=False)
                ]
                return _Text(" && ".join(pairs), TRUTH, _COMPARED if len(pairs) == 1 else _AND)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                yes, no = self._value(body), self._value(orelse)
                kind = REAL if REAL in (yes.type, no.type) else yes.type
                asked, first = self._value(test).within(_ATOM), self._as(kind, yes)
                last = self._as(kind, no)
                return _Text(
                    f"{asked} ? {first} : {f'({last})' if no.level == _CHOICE else last}", kind, _CHOICE
                )
            case ast.Call(func=function, args=args, keywords=[]):
                return self._call(node, function, [self._value(one) for one in args])
        raise self._refuse(node)

    def _name(self, node: ast.expr, name: str) -> _Text:
        if name in self.variables:
            variable = self.variables[name]
            return _Text(name, variable.type, root=name, address=variable.address)
        value = getattr(self.source.module, name, None)
        if not isinstance(value, int | float):
            raise self._refuse(node, "the name has no value before this place")
        kind = WHOLE if isinstance(value, int) else REAL
        if name in self.program.names:
            return _Text(self.program.names[name], kind)
        constants, plain = self.program.constants.setdefault(self.source.module, {}), name.lstrip("_")
        if name not in constants:
            constants[name] = f"{self._constant_comment(name)}#define {plain} {_literal(value)}\n"
        return _Text(plain, kind)

    def _constant_comment(self, name: str) -> str:
        """Return the comment above a module's constant."""
        lines = inspect.getsource(self.source.module).split("\n")
        at = next((i for i, line in enumerate(lines) if re.match(rf"{name}\b.* =|.*, {name} =", line)), 0)
        words: list[str] = []
        while at > 0 and lines[at - 1].startswith("#:"):
            at -= 1
            words.insert(0, lines[at].lstrip("#: "))
        return _comment(" ".join(words)) if words else ""

    def _member(self, node: ast.expr, of: _Text, name: str) -> _Text:
        text = f"{of.text}{'->' if of.address else '.'}{name}"
        if isinstance(of.type.members, Schema) and name in of.type.members.fields:
            found = of.type.members.fields[name]
            if isinstance(found, Number):
                kind = WHOLE if found.whole else REAL
                return _Text(text, Type(kind.name, lengths(found.shape)), root=of.root)
            return _Text(text, record(found), root=of.root)
        if isinstance(of.type.members, type) and name in (members := _member_types(of.type.members)):
            return _Text(text, members[name], root=of.root)
        raise self._refuse(node, f"{of.type.name} has no such member")

    def _entry(self, node: ast.expr, of: _Text, indices: Sequence[ast.expr]) -> _Text:
        if len(indices) > len(of.type.shape):
            raise self._refuse(node, "a named tuple has names, not places")
        text = of.text + "".join(f"[{self._value(one).text}]" for one in indices)
        return _Text(text, Type(of.type.name, of.type.shape[len(indices) :], of.type.members), root=of.root)

    def _operation(self, node: ast.BinOp, left: _Text, right: _Text) -> _Text:
        sign, level = _OPERATORS[type(node.op)]
        if {left.type, right.type} - {REAL, WHOLE} or (
            sign == "/" and isinstance(node.op, ast.FloorDiv) is (REAL in (left.type, right.type))
        ):
            raise self._refuse(node, "operands are numbers; / is for real ones, // for whole ones")
        kind = REAL if REAL in (left.type, right.type) else WHOLE
        sides = [
            _Text(self._as(kind, one), kind, one.level if one.type == kind else _SIGN)
            for one in (left, right)
        ]
        # subtraction and division do not associate, and addition rounds
        return _Text(f"{sides[0].within(level)} {sign} {sides[1].within(level + 1)}", kind, level)

    def _compared(self, node: ast.Compare, left: _Text, op: ast.cmpop, right: _Text) -> str:
        if type(op) not in _COMPARISONS:
            raise self._refuse(node)
        kind = REAL if REAL in (left.type, right.type) else WHOLE
        return f"{self._as(kind, left)} {_COMPARISONS[type(op)]} {self._as(kind, right)}"

    def _call(self, node: ast.Call, called: ast.expr, given: list[_Text]) -> _Text:
        name = ast.unparse(called)
        if name in ("min", "max"):
            limit = "ballbot_smaller" if name == "min" else "ballbot_larger"
            return _Text(f"{limit}({', '.join(self._as(REAL, one) for one in given)})", REAL)
        target = eval(name, {"abs": abs, **vars(self.source.module)})  # a name, or one of a module
        if isinstance(target, type) and issubclass(target, tuple):
            kind = self.program.struct(target)
            members = _member_types(target).values()
            return _Text(f"({kind.name}){{ {', '.join(map(self._as, members, given))} }}", kind)
        if getattr(target, "py_func", target) in self.program.externals:
            return self._external(node, self.program.externals[getattr(target, "py_func", target)], given)
        if not hasattr(target, "py_func"):
            raise self._refuse(node, "the function is not compiled")
        made = self.program.add(target, [one.type for one in given])
        if not all(map(Type.takes, made.parameters.values(), (one.type for one in given))):
            raise self._refuse(node, "the function is called with other types elsewhere")
        for (parameter, _), one in zip(made.parameters.items(), given, strict=True):
            if parameter in made.written:
                self._note(one.root, node)
        return _Text(f"{made.name}({', '.join(self._arguments(node, given))})", made.result)

    def _external(self, node: ast.Call, external: External, given: list[_Text]) -> _Text:
        for place in external.written:
            self._note(given[place].root, node)
        texts = self._arguments(node, given)
        if "{" in external.name:
            return _Text(external.name.format(*texts), external.result)
        return _Text(f"{external.name}({', '.join(texts)})", external.result)

    def _arguments(self, node: ast.Call, given: list[_Text]) -> list[str]:
        """Return arguments, records and large tuples by their address; those that C does not have are left out."""
        texts = []
        for one in given:
            if one.type == NOTHING:
                continue
            if one.type.by_address and not one.type.shape and not one.address:
                if one.level != _ATOM or one.text.endswith((")", "}")):
                    raise self._refuse(node, f"a {one.type.name} is passed by its address; give it a name")
                texts.append(f"&{one.text}")
            else:
                texts.append(one.text)
        return texts


def _literal(value: float) -> str:
    """Return a constant in single precision, or a whole number."""
    if isinstance(value, int):
        return str(value)
    text = str(np.float32(value)) if not math.isinf(value) else "INFINITY"
    return f"({text}f)" if value < 0.0 else f"{text}f"


def _loaded(target: ast.expr) -> ast.expr:
    """Return what is assigned to as an expression that is read."""
    copy = ast.parse(ast.unparse(target), mode="eval").body
    return ast.copy_location(copy, target)
