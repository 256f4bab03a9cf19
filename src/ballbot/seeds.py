"""Seeds of random numbers: what is one."""

from ballbot.errors import InputError


def check_seed(seed: int) -> None:
    """Refuse what cannot seed all of the random numbers here.

    Raises
    ------
    InputError
        Where it is none.
    """
    if not 0 <= seed < 2**32:
        raise InputError(f"The seed is {seed}; it must be a whole number from 0 to {2**32 - 1}.")
