"""Simulation: plants, the closed loop, batches of robots, sensors, one driveline, the ball on a clamped robot.

plant            the seam between a plant and whoever drives it
model_plant      the model as a plant; where the floor or the wheels' grip ends it
sensed_plant     the model with the robot's own sensors, delays, noise and a sloping floor
gear_play        the model with play in its gearboxes
sensors          encoders, AHRS, accelerometer, and fixes from outside
run              a plant with a controller becomes a `Log`
batch            many robots in closed loop in one compiled call; conditions has their disturbances
driveline        one driveline alone, under any friction law
upside_down      the ball on the wheels of a clamped robot
held_robot       a robot in its team's hands: on the ball, in the air, upside down
"""
