"""What a policy and an environment agree on: the order, units and scaling of what is observed and done, and when.

It is kept beside every trained policy.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict

from ballbot.control.controller import Controller
from ballbot.control.parts.policy import ERRORS, HISTORY, SCALES, SHOWN, VERSION
from ballbot.errors import InputError
from ballbot.files import read_json, write_text
from ballbot.schema import validate_table

_ERRORS = (
    ("forward position error", "m"),
    ("left position error", "m"),
    ("theta error in the heading frame", "rad"),
    ("phi error in the heading frame", "rad"),
    ("heading error", "rad"),
    ("forward velocity error", "m/s"),
    ("left velocity error", "m/s"),
    ("theta rate error in the heading frame", "rad/s"),
    ("phi rate error in the heading frame", "rad/s"),
    ("turning rate error", "rad/s"),
)


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One number of an observation or an action: a quantity over `scale`, limited to `limit` of it."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    name: str
    unit: str
    scale: float
    limit: float


@dataclass(frozen=True, kw_only=True)
class Contract:
    """The contract between a policy and an environment; equal if a policy of the one is one of the other.

    Examples
    --------
    >>> contract = Contract.of("alten", wheels=3, torque_limit=6.0, period=0.01)
    >>> len(contract.observation), len(contract.action)
    (19, 3)
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    version: int = VERSION
    robot: str  #: its name
    observation: tuple[Channel, ...]  #: in order
    action: tuple[Channel, ...]  #: in order: a torque for each wheel
    #: "torque" if an action is a wheel's torque, else the controller whose torques it is added to
    added_to: str = field(default="torque")
    observed: Literal["sensors", "state"] = "sensors"  #: the estimator's state, or the true one
    period: float  #: between two actions [s]
    delay: int = 0  #: samples by which torques act later than they were decided

    @staticmethod
    def of(
        robot: str,
        *,
        wheels: int,
        torque_limit: float,
        period: float,
        base: Controller | None = None,
        observed: Literal["sensors", "state"] = "sensors",
        delay: int = 0,
    ) -> Contract:
        """Return the contract of a robot's environment, with torques over the largest of an action [N m].

        They are added to those of `base`, if there is one.
        """
        numbers = base.packed.tobytes() if base else b""
        errors = [
            Channel(name=name, unit=unit, scale=scale, limit=limit)
            for (name, unit), scale, limit in zip(_ERRORS, SCALES, SHOWN, strict=True)
        ]
        assert len(errors) == ERRORS
        torques = [
            Channel(name=f"u{wheel} of {ago} actions ago", unit="N m", scale=torque_limit, limit=1.0)
            for ago in range(1, HISTORY + 1)
            for wheel in range(1, wheels + 1)
        ]
        return Contract(
            robot=robot,
            observation=(*errors, *torques),
            action=tuple(
                Channel(name=f"u{wheel}", unit="N m", scale=torque_limit, limit=1.0)
                for wheel in range(1, wheels + 1)
            ),
            added_to=f"controller {sha256(numbers).hexdigest()[:12]}" if base else "torque",
            observed=observed,
            period=period,
            delay=delay,
        )

    def write(self, path: str | Path) -> None:
        """Write the contract as JSON."""
        write_text(path, self.text())

    def text(self) -> str:
        """Return the contract as JSON."""
        return json.dumps(asdict(self), indent=1) + "\n"

    @staticmethod
    def read(path: str | Path) -> Contract:
        """Return the contract in a file; InputError if the file does not hold one."""
        tree = read_json(path)
        if not isinstance(tree, dict):
            raise InputError(f"{path} holds no contract of a policy.")
        return validate_table(Contract, tree, of=str(path))
