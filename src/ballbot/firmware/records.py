"""The records of the firmware: a controller's parameters, and the state that the application owns.

They are made of the records of the control law and of the safety layer. `FIRMWARE` is all of them; its digest stands in
the C sources and in every exported controller.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.law import LAW, MEMORY
from ballbot.control.records import Number, Schema, converted, schema_of
from ballbot.firmware.estimators import (
    KalmanMemory,
    KalmanRecord,
    OnboardMemory,
    OnboardRecord,
    ReadingRecord,
)

#: numbers in which the digest is exported
DIGEST_WORDS = 8


PARAMETERS = Schema(
    name="parameters",
    text="The numbers of one controller.",
    fields={
        "schema": Number(unit="1", shape=(DIGEST_WORDS,), whole=True),
        "wheel_count": Number(unit="1", whole=True),
        "sample_time": Number(unit="s"),
        "law": LAW,
    },
)
STATE = Schema(
    name="state",
    text="All that changes while the robot runs; zeros at the start.",
    fields={"memory": MEMORY},
)
FIRMWARE = Schema(
    name="firmware",
    fields={
        "parameters": PARAMETERS,
        "state": STATE,
        "reading": schema_of(ReadingRecord),
        "onboard": schema_of(OnboardRecord),
        "onboard_memory": schema_of(OnboardMemory),
        "kalman": schema_of(KalmanRecord),
        "kalman_memory": schema_of(KalmanMemory),
    },
)


def schema_words(schema: Schema) -> tuple[int, ...]:
    """Return a schema's digest as numbers of 31 bits."""
    digest = schema.digest
    return tuple(int(digest[8 * i : 8 * i + 8], 16) & 0x7FFFFFFF for i in range(DIGEST_WORDS))


def parameter_record(controller: Controller) -> NDArray[np.void]:
    """Return a controller's parameters (1,) of `PARAMETERS` in single precision.

    Raises
    ------
    InputError
        If single precision cannot hold a number.
    """
    record = PARAMETERS.zeros()
    record["schema"] = schema_words(FIRMWARE)
    record["wheel_count"] = len(controller.gain)
    record["sample_time"] = controller.sample_time
    record["law"] = controller.record
    return converted(record, PARAMETERS)
