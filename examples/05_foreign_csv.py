"""Write a recording as another team's firmware might: other names, units, wheel order and signs, semicolons.

python examples/05_foreign_csv.py run/log.csv balance.csv

The documentation's page "From a CSV file to a report" starts with this file and finds all of it out again.
"""

import sys

import numpy as np
from scipy.spatial.transform import Rotation

import ballbot

recorded, written = sys.argv[1:]
log, drive = ballbot.Log.read(recorded), ballbot.Robot.load("alten").drive
counts_per_turn = 4 * 500 * drive.gear_ratio  # four edges of each of the encoder's 500 lines
torque_per_ampere = drive.gear_ratio * drive.torque_constant

# the IMU is mounted 30 degrees to the left; R = Rx(theta) Ry(phi) Rz(psi) takes the body to the world
body = Rotation.from_euler("XYZ", np.column_stack([log["theta"], log["phi"], log["psi"]]))
imu = Rotation.from_euler("z", 30.0, degrees=True)
yaw, pitch, roll = (body * imu).as_euler("ZYX", degrees=True).T
gyro = np.degrees(imu.inv().apply(np.column_stack([log[f"gyro_{axis}"] for axis in "xyz"])))

columns = {"Timestamp_ms": np.round(1000.0 * log.t).astype(int)}
columns |= {"roll_deg": roll, "pitch_deg": pitch, "yaw_deg": yaw}
columns |= {f"Gyro{axis}_dps": gyro[:, i] for i, axis in enumerate("XYZ")}
# wheels 2 and 3 are exchanged, and wheel 2 is reversed
for number, (wheel, sign) in enumerate(((1, 1), (3, 1), (2, -1)), start=1):
    columns[f"enc{number}"] = np.round(sign * log[f"wheel{wheel}"] / (2.0 * np.pi) * counts_per_turn).astype(
        int
    )
    columns[f"cmd{number}"] = sign * log[f"u{wheel}"] / torque_per_ampere
with open(written, "w", encoding="utf-8") as file:
    file.write(";".join(columns) + "\n")
    for row in zip(*columns.values(), strict=True):
        cells = (str(value) if isinstance(value, np.integer) else f"{value:.4f}" for value in row)
        file.write(";".join(cells).replace(".", ",") + "\n")
print(f"{written}: {len(log.t)} rows, columns {', '.join(columns)}")
