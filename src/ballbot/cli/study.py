"""`ballbot study`: the main job, from a robot and its logs to a report and a controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.text import Text

from ballbot.cli.context import long_run, names_listed, read_balancing_logs
from ballbot.cli.findings import Accept, accept_argv, check_input
from ballbot.cli.output import progress_bar, standard_output
from ballbot.fitting.checkpoint import identity
from ballbot.identification import read_bounds
from ballbot.identification.windows import back_emf_of
from ballbot.log.checks import CheckedLogs
from ballbot.printable import shell_line
from ballbot.report.page import provenance
from ballbot.report.study import summary
from ballbot.report.study_files import STUDY_FILES, write_study
from ballbot.result_folder import result_folder
from ballbot.robot import Robot
from ballbot.twin.scenario import Scenario
from ballbot.twin.scenario_file import scenario_text
from ballbot.workflows.courses import PlantName
from ballbot.workflows.plant_draws import available_plant
from ballbot.workflows.study import StudyOptions
from ballbot.workflows.study import study as run_study


def study(
    robot: str,
    /,
    *logs: Path,
    out: Path,
    plant: PlantName | None = None,
    scenario: str = "nominal",
    draws: int = StudyOptions.draws,
    leave_out: str = "",
    mapping: Path | None = None,
    bounds: Path | None = None,
    seed: int = 0,
    accept: Accept = None,
    resume: bool = False,
    cluster: str | None = None,
) -> None:
    """Identify a robot's friction from its logs, validate the model, and choose the controller that does best on it.

    Writes report.html, results.json, robot.toml (with the identified friction), controller.toml, and
    previous_controller.toml to go back to. The candidates (nominal gain with no, full and partial compensation, and the
    precise controller) run on 20 simulated robots drawn from the identified uncertainty. With 6 robots or more
    results.json also predicts the chosen controller's next run; `ballbot validate --prediction` judges a log by it.

    Example: ballbot study alten square.csv hold.csv --out found

    Parameters
    ----------
    robot
        A preset's name or a robot file.
    logs
        One or more logs of the robot balancing, with torques and states.
    out
        The folder to write into.
    plant
        What the candidates run on: model (the equations of motion) or twin (the physics engine). If not given, the
        twin if MuJoCo is installed.
    scenario
        Delay, play, noise, sensors and floor of these robots: nominal, another scenario of the twin, or its file.
    draws
        Number of these robots. Fewer than 20 are quicker and leave the choice less certain.
    leave_out
        States whose errors do not count in the fit, separated by commas, such as psi,psi_dot if the ball pivots on
        the floor. They are validated all the same.
    mapping
        A TOML file that describes the columns and units of foreign logs, as `ballbot check-log` writes it.
    bounds
        A TOML file with lower and upper bounds of the friction parameters.
    seed
        Random seed. The same seed gives the same result.
    resume
        Continue an interrupted study in the same folder.
    cluster
        The address of a Dask scheduler on which the identification runs, such as tcp://10.0.0.5:8786.
    """
    described = Robot.load(robot)
    named = read_balancing_logs(logs, mapping, described)
    within = read_bounds(bounds) if bounds else None
    findings = check_input(
        described,
        dict(zip(logs, named.values(), strict=True)),
        accept=accept,
        source=robot,
        mappings=dict.fromkeys(logs, mapping),
    )
    files = [*_robot_file(robot), *logs, *(path for path in (mapping, bounds) if path)]
    files += [Path(scenario)] if Path(scenario).is_file() else []
    words = _words(
        robot,
        logs,
        out=out,
        plant=plant,
        scenario=scenario,
        draws=draws,
        leave_out=leave_out,
        mapping=mapping,
        bounds=bounds,
        seed=seed,
    )
    words += accept_argv(accept)
    made = provenance(command=shell_line(words), files=files, seed=seed)
    console = standard_output()
    back_emf = back_emf_of(mapping)
    left_out = names_listed(leave_out)
    tried, named_plant = Scenario.load(scenario, described), available_plant(plant)
    options = {"bounds": within, "left_out": left_out, "back_emf": back_emf, "seed": seed}
    options |= {"plant": named_plant, "scenario": scenario_text(tried), "draws": draws}
    belongs_to = identity(described, list(named.values()), options)
    with (
        result_folder(out, command="study", names=STUDY_FILES, inputs=files, resumes=True) as folder,
        long_run(
            folder.path, words=words, belongs_to=belongs_to, resume=resume, cluster=cluster, seed=seed
        ) as run,
        progress_bar(console, "reading") as bar,
    ):
        result = run_study(
            described,
            CheckedLogs(logs=named, findings=findings),
            plant=named_plant,
            scenario=tried,
            options=StudyOptions(bounds=within, excluded_states=left_out, back_emf=back_emf, draws=draws),
            run=replace(run, progress=bar.report),
        )
        bar.show(1.0, doing="writing the report")
        with folder.replaced() as new:
            write_study(result, new, made=made, before=folder.path)
    for heading, sentences in summary(result):
        console.print(Text(f"{heading}: ", style="bold"), end="")
        console.print(sentences, soft_wrap=True)
    console.print(str(folder.path / "report.html"), soft_wrap=True)


def _robot_file(robot: str) -> list[Path]:
    return [] if robot in Robot.presets() else [Path(robot)]


def _words(
    robot: str,
    logs: Sequence[Path],
    *,
    out: Path,
    plant: str | None,
    scenario: str,
    draws: int,
    leave_out: str,
    mapping: Path | None,
    bounds: Path | None,
    seed: int,
) -> list[str]:
    """Return the command line that makes this study again, without what it accepts."""
    words = ["ballbot", "study", robot, *map(str, logs), "--out", str(out)]
    words += ["--plant", plant] if plant else []
    words += ["--scenario", scenario] if scenario != "nominal" else []
    words += ["--draws", str(draws)] if draws != StudyOptions.draws else []
    words += ["--leave-out", leave_out] if leave_out else []
    words += ["--mapping", str(mapping)] if mapping else []
    words += ["--bounds", str(bounds)] if bounds else []
    words += ["--seed", str(seed)] if seed else []
    return words
