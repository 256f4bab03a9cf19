"""Lists of names on the API page, as autodoc's directives.

    ## ballbot.control.safety

    ```{api}
    __doc__ SafetyLimits SafeController
    ```

shows the own text (``__doc__``), classes, exceptions and functions of the module in the heading. ``Log(*)`` shows all
members of a class, ``Robot(load,presets)`` these, and ``Ball`` alone its fields.
"""

import importlib
import inspect
import re
from collections.abc import Iterator

from sphinx.application import Sphinx

_BLOCK = re.compile(r"^(## (ballbot\S*)\n\n)```\{api\}\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)
_NAME = re.compile(r"(\w+)(?:\((\S+)\))?")


def read(_: Sphinx, page: str, source: list[str]) -> None:
    """Turn the lists of a page into blocks of reStructuredText."""
    del page
    source[0] = _BLOCK.sub(
        lambda found: "\n".join([f"{found[1]}```{{eval-rst}}", *_directives(found[2], found[3]), "```"]),
        source[0],
    )


def _directives(module: str, names: str) -> Iterator[str]:
    for name, members in _NAME.findall(names):
        if name == "__doc__":
            yield from (f".. automodule:: {module}", "   :no-index:", "")
            continue
        documented = getattr(importlib.import_module(module), name)
        kind = "function"
        if inspect.isclass(documented):
            kind = "exception" if issubclass(documented, Exception) else "class"
        yield f".. auto{kind}:: {module}.{name}"
        if members:
            yield f"   :members: {'' if members == '*' else members}".rstrip()
            yield from ["   :inherited-members:"] if members == "*" else []
        yield ""


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect the step above."""
    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
