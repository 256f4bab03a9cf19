"""Public records of joints of arms, and what is published of their friction; docs/axis.md says where they are from."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbot.identification.axis import AxisRecord, record_of_rows


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A public record of one joint, and what is published of it."""

    name: str
    file: str  #: in the folder axes
    force: str  #: its column
    viscous: float  #: published [N m s/rad]
    coulomb: float  #: published [N m]
    lacks: str  #: what of the motion's causes the record does not have
    gravity: bool = True  #: whether the plain fit has gravity: the axis is not vertical

    def read(self, folder: Path) -> AxisRecord:
        """Return the record from the folder of public data."""
        rows = np.genfromtxt(folder / "axes" / self.file, delimiter=",", names=True)
        return record_of_rows(self.name, rows["t_s"], rows[self.force], rows["position_rad"], unit="rad")


_TX40 = (
    (1, 8.05, 7.14, "velocity; coupling"),
    (2, 5.53, 8.26, "velocity; coupling; gravity of the arm beyond"),
    (3, 1.97, 6.34, "velocity; coupling; gravity by the sum of two angles"),
    (4, 1.11, 2.48, "velocity; coupling"),
    (5, 1.86, 3.03, "velocity; joint 6, which its motor also turns"),
    (6, 0.65, 0.282, "velocity; joint 5, whose motor also turns it"),
)
_OPENARM = ((3, 0.266, 0.3375), (4, 0.0, 0.8388), (6, 0.0, 0.1677), (7, 0.0055, 0.1131))
JOINTS = (
    *(
        Joint(
            name=f"TX40 {number}",
            file=f"tx40/tx40_joint{number}.csv.gz",
            force="torque_joint_Nm",
            viscous=b,
            coulomb=c,
            lacks=lacks,
            gravity=number > 1,
        )
        for number, b, c, lacks in _TX40
    ),
    Joint(
        name="Panda 7",
        file="panda/panda_traj1_joint7.csv.gz",
        force="torque_joint_Nm",
        viscous=0.0,
        coulomb=0.282,
        lacks="the rotor's inertia, which is before the torque sensor",
    ),
    *(
        Joint(
            name=f"OpenArm {number}",
            file=f"openarm/openarm_collect_joint{number}.csv.gz",
            force="torque_measured_Nm",
            viscous=b,
            coulomb=c,
            lacks="rows: 12 to 35 a second, uneven, and mostly at rest",
        )
        for number, b, c in _OPENARM
    ),
)
