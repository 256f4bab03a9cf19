"""Licences of the packages that Ballbot imports, by the installed packages' own metadata, as one page.

.venv/bin/python -m campaigns.licences     writes docs/generated/licences.md
"""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, metadata, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from ballbot.files import write_text

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "generated" / "licences.md"
#: what pip installs without any option, as the page calls it
ALWAYS = "always"
#: options of those who change Ballbot; of what they list, its own code imports these two, on request
TOOLS, ON_REQUEST = ("test", "docs", "dev"), ("unicorn", "ziglang")
#: licences under which a work that contains the package has duties beyond naming it, or that must be bought
_APART = re.compile(r"GPL|General Public|MPL|Mozilla|Proprietary|license-agreement", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Package:
    """An installed package, its licence, and what it brings."""

    name: str
    option: str  #: of Ballbot's, that installs it
    version: str = "not installed"
    licence: str = "unknown"
    brings: list["Package"] = field(default_factory=list)

    @property
    def apart(self) -> list["Package"]:
        """Itself and what it brings, where the licence is apart."""
        return [one for one in (self, *self.brings) if _APART.search(one.licence)]


def imported() -> list[Package]:
    """Return the packages that Ballbot imports, in the order of pyproject.toml."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    listed = {ALWAYS: project["dependencies"], **project["optional-dependencies"]}
    found: dict[str, Package] = {}
    for option, lines in listed.items():
        for line in lines:
            name = Requirement(line).name
            if name != project["name"] and (option not in TOOLS or name in ON_REQUEST):
                found.setdefault(name, _package(Requirement(line), option))
    return list(found.values())


def _package(wanted: Requirement, option: str) -> Package:
    try:
        said = metadata(wanted.name)
    except PackageNotFoundError:
        return Package(name=wanted.name, option=option)
    brought: dict[str, Package] = {}
    for needed in _needs(wanted):
        one = _package(needed, option)
        brought |= {canonicalize_name(other.name): other for other in (one, *one.brings)}
    return Package(
        name=wanted.name,
        option=option,
        version=said["Version"],
        licence=_licence(wanted.name),
        brings=[brought[name] for name in sorted(brought)],
    )


def _needs(wanted: Requirement) -> Iterator[Requirement]:
    for line in requires(wanted.name) or ():
        needed = Requirement(line)
        options = ("", *wanted.extras)
        if needed.marker is None or any(needed.marker.evaluate({"extra": each}) for each in options):
            yield needed


def _licence(name: str) -> str:
    """Return what a package's metadata says of its licence, and in its description of the GPL."""
    said = metadata(name)
    classes = [each.rpartition(" :: ")[2] for each in said.get_all("Classifier", []) if "License ::" in each]
    words = (said["License"] or "").strip()
    short = words if words and "\n" not in words and words != "UNKNOWN" else ""
    stated = said["License-Expression"] or short or ", ".join(classes) or "unknown"
    further = re.search(r"licen[cs]e (GPL\S+)", said["Description"] or "")
    return f"{stated}; its description: {further[1]}" if further else stated


def page(packages: list[Package]) -> str:
    """Return the page as Markdown."""
    rows = [f"| {one.name} | {one.option} | {one.version} | {one.licence} |" for one in packages]
    apart = [
        f"- `{each.name}` {each.version}{'' if each is one else f', which {one.name} brings'} "
        f"(option `{one.option}`): {each.licence}"
        for one in packages
        for each in one.apart
    ]
    kinds: dict[str, set[str]] = {}
    own = {canonicalize_name(one.name) for one in packages}
    for each in (each for one in packages for each in one.brings):
        if canonicalize_name(each.name) not in own:
            kinds.setdefault(each.licence, set()).add(canonicalize_name(each.name))
    brought = [f"| {kind} | {', '.join(sorted(kinds[kind]))} |" for kind in sorted(kinds)]
    lines = "\n".join
    return f"""# Licences

Ballbot is under the MIT licence, and so is uPlot, the only code of others that it contains (in the viewer's pages).
`python -m campaigns.licences` writes this page from the metadata of the packages that are installed.

## Apart

Packages whose licence asks for more than naming it. None is installed unless asked for: `plan` imports CasADi; `export`
imports unicorn, if it is installed, to count instructions on an emulated processor; only tests import Drake. Before you
pass on a program together with one of them, read its licence.

{lines(apart)}

## What Ballbot imports

`pip install "ballbot[OPTION]"` installs the packages of an option.

| package | option | version | licence |
|---|---|---|---|
{lines(rows)}

## What those packages bring

| licence | packages |
|---|---|
{lines(brought)}
"""


if __name__ == "__main__":
    write_text(PAGE, page(imported()))
