"""How a foreign log becomes one of Ballbot's: a mapping inferred, tested against the robot, with its evidence.

names, name_series, name_words
                         what a column's name says: kind, axis or wheel, unit
roles                    which column is which quantity, by name
column_values            which column is which quantity, by its values
open_names               the choices that names leave, by the values
gyro_columns             the gyro, under any name
wheel_speeds             speeds in place of angles
wrapped_encoders         encoders that begin again after a power of two
recognition              the columns of a file with their roles, by all of these
time_units, counted_time the unit of the time, and how long a count is
units                    units of lean, wheels and heading
measured                 what the sensors show with units, and the units that the motion confirms
file_signals             the columns on even rows, filtered; the axes of the gyro
gyro_handedness          whether roll, pitch and yaw have one handedness, by the gyro
placement                how the lean responds to the wheels
placements               every order and sign of the wheels, compared
frame                    order, signs, the IMU's turn and reversed axes that follow
wheel_response           how late the wheels answer to the commands
command_signs            the number that stands for no command, or the columns with the directions of magnitudes
commands, drive          which command drives which wheel, how often wheels turn against it
command_units            kind and unit of the commands
stall                    what duties give at standstill, and the motors' resistance
dead_band                how large the dead band is, by the motion
evidence                 a conclusion with its confidence
tolerances               what an unknown delay or turn would change, and the confidence that follows
proposal                 all of this for one file (`propose`)
conclusions              the conclusions of a proposal
command_conclusions      those on its commands
mapping_text             the mapping file
refusal                  why a proposal cannot be used
report                   findings, the mapping file and the log that it makes (`evaluate`)
"""
