"""The zero of a function of one number, in compiled code."""

from ballbot.mechanics.compiled import inlined

_MOST_STEPS = 100
_EPS = 2.220446049250313e-16


@inlined
def crossing(function, context, low, high):
    """Return where function(x, context) is zero, between `low` and `high`, at which its signs differ.

    Ridders' method (C. Ridders, A new algorithm for computing a single root of a real continuous function, IEEE
    Transactions on Circuits and Systems 26, 1979): each step at least halves the bracket. Of the last bracket, the
    end is returned at which the function is smaller.
    """
    f_low, f_high = function(low, context), function(high, context)
    if f_low == 0.0:
        return low
    if f_high == 0.0:
        return high
    for _ in range(_MOST_STEPS):
        middle = 0.5 * (low + high)
        f_middle = function(middle, context)
        if f_middle == 0.0:
            return middle
        root = (f_middle * f_middle - f_low * f_high) ** 0.5
        x = middle + (middle - low) * (f_middle / root if f_low > f_high else -f_middle / root)
        f_x = function(x, context)
        if f_x == 0.0:
            return x
        if (f_middle > 0.0) != (f_x > 0.0):
            low, f_low, high, f_high = (
                (middle, f_middle, x, f_x) if middle < x else (x, f_x, middle, f_middle)
            )
        elif (f_low > 0.0) != (f_x > 0.0):
            high, f_high = x, f_x
        else:
            low, f_low = x, f_x
        if high - low <= 2.0 * _EPS * max(abs(low), abs(high)):
            break
    return low if abs(f_low) < abs(f_high) else high
