"""The one error a user's input can raise: a sentence that says what was wrong, where, and what would be right."""


class InputError(ValueError):
    """Bad input: a file, an option or an argument. Its text is one sentence and is all that the user is shown."""


class CompiledCodeNotKept(UserWarning):
    """Numba has no folder for compiled code."""
