"""A new user's first half minute, by the clock: writes docs/generated/first_use.md.

.venv/bin/python -m benchmarks.first_use [--environments 5]

The wheel is built and installed without extras into fresh environments, each with nothing compiled on disk. In each a
first simulation runs, then `ballbot demo`: until it names the page, and until the page has its result. Then what
stands beside it, in environments of their own. Needs a package index.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import venv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import monotonic

from ballbot.files import write_text
from benchmarks.run import processor

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "generated" / "first_use.md"

#: the server of viser's own scene, until its page has come whole
_VISER = """
import urllib.request, viser
server = viser.ViserServer(port=0, verbose=False)
server.scene.add_icosphere("/ball", radius=0.11)
urllib.request.urlopen(f"http://127.0.0.1:{server.get_port()}/").read()
print("page", flush=True)
server.stop()
"""
#: mujoco.sysid on its smallest use, as its package has no demo: the damping of a pendulum from 2 s, until its report
_SYSID = """
from pathlib import Path
import mujoco, numpy as np
from mujoco import sysid
xml = '<mujoco><option timestep="0.005"/><worldbody><body><joint name="pin" axis="0 1 0" damping="0.03"/>'
xml += '<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02"/></body></worldbody><actuator><motor name="u" joint='
xml += '"pin"/></actuator><sensor><jointpos name="angle" joint="pin"/></sensor></mujoco>'
spec = mujoco.MjSpec.from_string(xml)
model = spec.compile()
data = mujoco.MjData(model)
times = 0.005 * np.arange(1, 401)
u, angles = np.sin(6.0 * times)[:, None], []
start = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)
for value in u:
    data.ctrl[:] = value
    mujoco.mj_step(model, data)
    angles.append(data.sensordata.copy())
held = sysid.TimeSeries(np.append(0.0, times), np.append(u, u[-1:], axis=0))
measured = sysid.TimeSeries.from_names(times, np.array(angles), model)
runs = [sysid.ModelSequences("pendulum", spec, ["run"], [start], [held], [measured])]

def damp(spec, parameter):
    spec.joint("pin").damping = [parameter.value[0], 0.0, 0.0]

def parameters():
    found = sysid.ParameterDict()
    found.add(sysid.Parameter("damping", 0.1, 0.001, 1.0, modifier=damp))
    return found

residuals = sysid.build_residual_fn(models_sequences=runs)
fitted, result = sysid.optimize(parameters(), residuals, optimizer="mujoco", verbose=False)
report = sysid.default_report(runs, parameters(), fitted, residuals, result, generate_videos=False)
Path("report.html").write_text(report.build(), encoding="utf-8")
print("report", fitted["damping"].value, flush=True)
"""


#: a first call from the README
_SIMULATE = "simulate alten --reference circle --duration 20 --out run1"

_NOT_PASSED_ON = ("PYTHONPATH", "VIRTUAL_ENV", "NUMBA_CACHE_DIR")


@dataclass(frozen=True)
class Timed:
    """Wall seconds from a command's start until each line that it printed, and what it took as a whole."""

    lines: tuple[tuple[float, str], ...]
    wall: float
    cpu: float  #: of the process and of those that it waited for

    def until(self, part: str) -> float:
        """Return the seconds until the first line with `part` in it."""
        return next(seconds for seconds, line in self.lines if part in line)


def timed(words: Sequence[object], folder: Path) -> Timed:
    """Run a command outside this environment; stop with what it printed if it fails."""
    environment = {name: value for name, value in os.environ.items() if name not in _NOT_PASSED_ON}
    begun = monotonic()
    line = [str(word) for word in words]
    with subprocess.Popen(
        line, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        lines = tuple((monotonic() - begun, text) for text in process.stdout or ())
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"{' '.join(line)}\n{''.join(text for _, text in lines)}")
    return Timed(lines=lines, wall=monotonic() - begun, cpu=used.ru_utime + used.ru_stime)


@dataclass(frozen=True)
class FirstUse:
    """Seconds of one fresh environment."""

    install: float
    call: float  #: a first simulation, from its start to its end
    picture: float  #: until the command names the page, or the page has come
    report: float  #: until the result is there
    cpu: float  #: of the command, without the installation


def fresh(folder: Path, package: object) -> tuple[Path, float]:
    """Return the Python of a new environment with a package in it, and the seconds that the installation took."""
    venv.create(folder, with_pip=True)
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    return python, timed([python, "-m", "pip", "install", "--quiet", package], folder).wall


def first_use(folder: Path, wheel: Path) -> FirstUse:
    """Return how long a fresh environment took with a first simulation and with `ballbot demo`."""
    python, install = fresh(folder, wheel)
    call = timed([python, "-m", "ballbot", *_SIMULATE.split()], folder).wall
    for cached in folder.rglob("*.nb[ci]"):
        cached.unlink()  # so that the demo finds nothing compiled either
    run = timed([python, "-m", "ballbot", "demo", "--no-browser", "--out", "look"], folder)
    assert "look" in run.lines[0][1] or "preparing" in run.lines[0][1], run.lines
    return FirstUse(
        install=install,
        call=call,
        picture=run.until("demo.html"),
        report=run.until("Identified on"),
        cpu=run.cpu,
    )


def other(folder: Path, package: str, code: str) -> tuple[float, float]:
    """Return the seconds of another package's installation, and those of its code until its line."""
    python, install = fresh(folder, package)
    return install, timed([python, "-c", code], folder).lines[-1][0]


def main() -> None:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.first_use", description=__doc__)
    parser.add_argument("--environments", type=int, default=5, help="fresh environments with Ballbot")
    count = parser.parse_args().environments
    with tempfile.TemporaryDirectory(prefix="ballbot-first-use-") as name:
        folder = Path(name)
        wheel = build(folder / "wheel")
        runs = [first_use(folder / f"ballbot{number}", wheel) for number in range(count)]
        busy = os.getloadavg()[1]
        viser = other(folder / "viser", "viser", _VISER)
        sysid = other(folder / "sysid", "mujoco[sysid]>=4", _SYSID)
    others = (
        (
            "viser, a server with one ball, until its page has come",
            f"{viser[0]:.1f}",
            "",
            f"{viser[1]:.1f}",
            "",
            "",
        ),
        ("mujoco.sysid, one parameter of a pendulum", f"{sysid[0]:.1f}", "", "", f"{sysid[1]:.1f}", ""),
    )
    rows = (_row("Ballbot", runs), *others)
    write_text(PAGE, page(rows, count, busy=busy))
    print(PAGE.read_text(encoding="utf-8"))


def build(folder: Path) -> Path:
    """Return the wheel, built into a folder."""
    folder.mkdir()
    builder = folder / "environment"
    venv.create(builder, with_pip=True)
    python = builder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    line = [python, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, ROOT]
    timed(line, folder)
    (wheel,) = folder.glob("ballbot-*.whl")
    return wheel


def _row(name: str, runs: Sequence[FirstUse]) -> tuple[str, ...]:
    """Return the row of Ballbot's table."""

    def shown(what: str) -> str:
        values = sorted(getattr(run, what) for run in runs)
        spread = f" ({values[0]:.1f} to {values[-1]:.1f})" if len(values) > 1 else ""
        return f"{median(values):.1f}{spread}"

    return name, *(shown(what) for what in ("install", "call", "picture", "report", "cpu"))


def page(rows: Sequence[tuple[str, ...]], count: int, *, busy: float) -> str:
    """Return the page's text."""
    return f"""# The first half minute

`python -m benchmarks.first_use` writes this page: seconds by the clock in fresh environments with nothing compiled on
disk, the wheel installed without extras; the median of {count} environments, with the least and the most.
{processor()}, {os.cpu_count()} cores, load average {busy:.0f}. The targets are 15 s
for the first call, 5 s for the picture and 30 s for the report.

| | install | first call | first picture | first report | processor time of the demo |
|---|---:|---:|---:|---:|---:|
{chr(10).join("| " + " | ".join(row) + " |" for row in rows)}

First call: `ballbot {_SIMULATE}`, from its start to its end.
First picture: `ballbot demo` names an HTML page that plays two recorded runs. First report: that page shows the
friction identified from the first run's log. Both commands compile first what they need. The other two are the
smallest uses of their packages that show a picture or a report; neither ships recorded runs, and what they show is not
the same.
"""


if __name__ == "__main__":
    main()
