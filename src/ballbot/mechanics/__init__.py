"""The robot's mechanics: geometry, equations of motion, friction, and the step in which friction may stick.

geometry, parameters     where the wheels sit; one robot's numbers as compiled code reads them
equations                mass matrix and forces, from attitude and velocities; accelerations solves them
friction                 the friction law; friction_laws/ has the alternatives, one file each
contacts, stick_slip     where friction acts, and the convex step that finds the sticking contacts
model                    all of it as one object, with its linearisation
engine/                  the compiled forms: many robots side by side, on the processor or a GPU
"""
