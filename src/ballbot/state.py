"""The state and the inputs of every robot by name, in the order of every array: in logs, files, models and controllers.

x = [x y theta phi psi, and their rates]        [m, rad, m/s, rad/s]
u = [u1 .. un]                                  wheel torques [N m]
"""

POSITION_NAMES = ("x", "y", "theta", "phi", "psi")
STATE_NAMES = (*POSITION_NAMES, *(f"{name}_dot" for name in POSITION_NAMES))


def torque_names(count: int) -> tuple[str, ...]:
    """Return u1 .. u`count`, the wheel torques [N m]."""
    return tuple(f"u{i}" for i in range(1, count + 1))
