"""The robot's mechanics: geometry, equations of motion, friction, and the step in which friction may stick.

geometry, parameters     where the wheels sit; one robot's numbers as compiled code reads them
equations                mass matrix and forces, from attitude and velocities; and their solution
friction, floor          the friction law of the wheels, and the floor's friction on the ball
driveline                one driveline's motion
contacts, stick_slip     where friction acts, and the convex step that finds the sticking contacts
traction                 forces between wheels and ball, and the torque that their grip transmits
model                    all of it as one object, with its linearisation
engine/                  the compiled forms: many robots side by side

A friction law of its own is a function and its parameters, registered (`ballbot.robot.friction_law`): equations,
identification, compensation and twin ask it, and nothing here changes.

How to change a term of the classical law. `mechanics/equations.py` has the equations once, as scalar code that
`mechanics/engine/` inlines into loops over robots. The places, from `src/ballbot`:

parameter          `robot/components.py`: the field of `Friction`, and `scaled_friction`; `Robot.rolling_force` for the
                   floor
law                `mechanics/friction.py` for wheels, `mechanics/floor.py` for the rolling ball: NumPy's form and the
                   compiled one
packed row         `mechanics/parameters.py`: a field of `RobotNumbers` and its value in `pack`
smooth motion      `mechanics/engine/smooth.py`: in `net_torques`, and a new change of sign
at rest            a limit: `mechanics/stick_slip.py` and `mechanics/engine/convex.py`; a smooth term: `free_motion` in
                   `mechanics/contacts.py`
linearisation      `Model.linearize` in `mechanics/model.py`
control            `control/parts/compensation.py`, `control/file.py`, and `control/overcompensation.py` for the
                   cautious friction
identification     `identification/quantities.py`: a `Quantity`;
                   `identification/prediction.py` writes it into the packed row, `identification/result.py` into the
                   robot
twin               `twin/mjcf.py` or `twin/driveline.py`
reports            `report/identification.py` and `robot/derived.py`
"""
