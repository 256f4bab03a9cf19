"""The two models that a validation holds side by side, each a robot in a formulation, and what to call them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ballbot.errors import InputError
from ballbot.mechanics.model import Model
from ballbot.robot import Friction

#: the two formulations, as sentences call them
_FORMULATIONS = {"exact": "in the exact formulation", "thesis": "in the thesis's formulation"}


@dataclass(frozen=True, kw_only=True)
class NamedModel:
    """A model and its name, which reads on from "the model": "with friction", or "of soft.toml"."""

    name: str
    model: Model


@dataclass(frozen=True, kw_only=True)
class ModelPair:
    """Two models of robots with as many wheels; the first is judged, the second is what it is held against.

    Raises
    ------
    InputError
        Where they have the same name, are the same model, or have not as many wheels.
    """

    first: NamedModel
    second: NamedModel

    def __post_init__(self) -> None:
        first, second = self.first, self.second
        if first.name == second.name:
            raise InputError(f"Both models are called {first.name!r}; give them different names.")
        counts = [one.model.robot.wheel_count for one in (first, second)]
        if counts[0] != counts[1]:
            raise InputError(
                f"The model {first.name} has {counts[0]} wheels and the model {second.name} "
                f"has {counts[1]} wheels; both must be of the robot that was logged."
            )
        same_form = first.model.formulation == second.model.formulation
        if same_form and np.array_equal(first.model.packed, second.model.packed):
            raise InputError(
                f"The model {first.name} and the model {second.name} are the same; there is nothing to compare."
            )

    @staticmethod
    def by_friction(model: Model) -> ModelPair:
        """Return a model as it is, beside itself without any friction.

        Raises
        ------
        InputError
            Where it has no friction.
        """
        robot = model.robot
        none = Friction.none(robot.wheel_count)
        if robot.friction == none:
            raise InputError(
                f"The robot {robot.name} has no friction to validate. Identify it with `ballbot identify`, or compare "
                "two models with --against."
            )
        return ModelPair(
            first=NamedModel(name="with friction", model=model),
            second=NamedModel(
                name="without friction", model=replace(model, robot=robot.replace(friction=none))
            ),
        )

    @staticmethod
    def by_formulation(model: Model) -> ModelPair:
        """Return a model beside the same robot in the other formulation."""
        other = replace(model, formulation="thesis" if model.formulation == "exact" else "exact")
        first, second = (NamedModel(name=_FORMULATIONS[one.formulation], model=one) for one in (model, other))
        return ModelPair(first=first, second=second)

    @staticmethod
    def of_two(first: Model, second: Model, *, files: tuple[str, str] | None = None) -> ModelPair:
        """Return two models called by their robots' names, or by the files they came from where these are given."""
        names = files or (first.robot.name, second.robot.name)
        if names[0] == names[1]:
            names = tuple(
                f"{name} ({one.formulation})" for name, one in zip(names, (first, second), strict=True)
            )
        return ModelPair(
            first=NamedModel(name=f"of {names[0]}", model=first),
            second=NamedModel(name=f"of {names[1]}", model=second),
        )

    @property
    def names(self) -> tuple[str, str]:
        """Of the first and the second."""
        return (self.first.name, self.second.name)

    @property
    def both(self) -> tuple[Model, Model]:
        """The first model, then the second."""
        return (self.first.model, self.second.model)
