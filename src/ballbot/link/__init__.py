"""The link to a robot: messages in frames over a serial line, or to an emulated robot.

messages     what host and robot send each other: one schema each, from which the structs in C are written too
frames       messages to bytes and back, with every check that a frame must pass
transport    a serial port behind three functions
session      handshake, watchdogs, arming in two steps, parameters: the host's side of a connection
emulated     firmware in lock-step with a plant, behind a transport
recorder     a log that is written while the robot runs and survives a pulled plug
stream       rows to programs that show the robot live: JSON over UDP, or Foxglove's server (foxglove_server)
references   where the robot is asked to be: courses, files, the keyboard
live         a robot while it runs: references or torques, and its samples
connection   a run from the self-test to disarming, its log, and what a terminal shows meanwhile
operators    the person at the robot: confirms arming, moves it by hand
bench        torques of a robot that is held: a sweep of its wheels, and upside down
wiring       whether the IMU's axes and the encoders are those of the robot
"""
