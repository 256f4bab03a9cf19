"""Simulation: plants, the closed loop, batches of robots, sensors, one driveline, the ball on a clamped robot.

plant            the seam between a plant and whoever drives it
model_plant      the model as a plant; where the floor or the wheels' grip ends it
imperfections    a robot's sensors, drive, rollers and floor, and the record of them that the loop reads
loop             the closed loop, compiled: sensors, estimator, law, drive and mechanics
sensed_plant     the same loop one sample at a time, for controllers in Python
sensors          encoders, AHRS, accelerometer, and fixes from outside
run              a plant with a controller becomes a `Log`
batch            many robots in closed loop in one compiled call
driveline        one driveline alone, under any friction law
upside_down      the ball on the wheels of a clamped robot
held_robot       a robot in its team's hands: on the ball, in the air, upside down
"""
