"""Trigonometry in degrees: the same bits on every platform, within one unit in the last place.

The functions of C libraries take radians, so that `sin(180 deg)` is not zero, and differ from library to
library. These use the basic operations of IEEE 754 alone (`+ - * /`, `sqrt`, and the exact `fmod`, `frexp`,
`ldexp`).

An angle is reduced exactly, modulo 360 degrees and then to at most 45 degrees from a multiple of 90. Sine and
cosine of the rest are polynomials in degrees, fitted to them, with leading terms exact or compensated. The
tangent is the quotient of Taylor series in radians, each a sum of two floats, a value and its rounding error
("double-double": T. J. Dekker, A floating-point technique for extending the available precision, 1971).
The inverse functions look up the arc tangent of the nearest sixteenth and add a series for the difference.
All errors before the last rounding together stay below half a unit. `sine` and `cosine`, which behaviors use
most, repeat the reduction of `quarters_and_rest` in place: the call would add a seventh to their time.

Pure functions without constants of the module: the Python backend copies the text of those that a program
uses.
"""

from __future__ import annotations

from math import copysign, fmod, frexp, inf, isfinite, isinf, ldexp, nan, sqrt


def product_and_error(x: float, y: float) -> tuple[float, float]:
    """Return the rounded product and its rounding error, exactly (Dekker), for factors of moderate size."""
    product = x * y
    scaled = 134217729.0 * x
    x_high = scaled - (scaled - x)
    x_low = x - x_high
    scaled = 134217729.0 * y
    y_high = scaled - (scaled - y)
    y_low = y - y_high
    return product, x_low * y_low - (((product - x_high * y_high) - x_low * y_high) - x_high * y_low)


def quarters_and_rest(x: float) -> tuple[int, float]:
    """Return the nearest multiple of 90 degrees, as its number modulo 4, and the exact rest: at most 45."""
    turned = fmod(x, 360.0)
    quarters = round(turned / 90.0)
    return quarters & 3, turned - 90.0 * quarters


def in_radians(x: float) -> tuple[float, float]:
    """Return at most 45 degrees in radians, as a sum of two floats."""
    high, low = product_and_error(x, 0.017453292519943295)
    return high, low + x * 2.9486522708701687e-19


def sine_of_rest(x: float) -> tuple[float, float]:
    """Return the sine of at most 45 degrees as a sum of two floats, the second much the smaller."""
    high, low = in_radians(x)
    z = high * high
    series = 2.8114572543455206e-15
    series = -7.647163731819816e-13 + z * series
    series = 1.6059043836821613e-10 + z * series
    series = -2.505210838544172e-08 + z * series
    series = 2.7557319223985893e-06 + z * series
    series = -0.0001984126984126984 + z * series
    series = 0.008333333333333333 + z * series
    series = -0.16666666666666666 + z * series
    series = high * (z * series) + low * (1.0 - 0.5 * z)
    value = high + series
    return value, (high - value) + series


def cosine_of_rest(x: float) -> tuple[float, float]:
    """Return the cosine of at most 45 degrees as a sum of two floats, the second much the smaller."""
    high, low = in_radians(x)
    z, z_low = product_and_error(high, high)
    half = 0.5 * z
    value = 1.0 - half
    series = -1.5619206968586225e-16
    series = 4.779477332387385e-14 + z * series
    series = -1.1470745597729725e-11 + z * series
    series = 2.08767569878681e-09 + z * series
    series = -2.755731922398589e-07 + z * series
    series = 2.48015873015873e-05 + z * series
    series = -0.001388888888888889 + z * series
    series = 0.041666666666666664 + z * series
    series = ((1.0 - value) - half) + (z * (z * series) - 0.5 * z_low - high * low)
    rounded = value + series
    return rounded, (value - rounded) + series


def sine_near_zero(x: float) -> float:
    """Return the sine of at most 45 degrees.

    The linear term is exact but for its last part: its factor and the high part of `x` have 26 bits each.
    """
    scaled = 134217729.0 * x
    high = scaled - (scaled - x)
    z = x * x
    series = -1.1467754740637923e-27 + z * 2.2197180143346243e-33
    series = -9.788384859392164e-17 + z * (4.141266948173571e-22 + z * series)
    series = -8.860961557012979e-07 + z * (1.3496016231628688e-11 + z * series)
    low = (x - high) * 0.01745329238474369 + x * 1.3519960527851425e-10
    return high * 0.01745329238474369 + (low + x * (z * series))


def cosine_near_zero(x: float) -> float:
    """Return the cosine of at most 45 degrees."""
    z = x * x
    series = 1.6679335411070536e-30 + z * -2.770293977358139e-36
    series = 2.1354943033520361e-19 + z * (-7.227874651622457e-25 + z * series)
    series = 3.866323851562994e-09 + z * (-3.9258319857426733e-14 + z * series)
    square = z * 0.0001523087098933543
    value = 1.0 - square
    return value + (((1.0 - value) - square) + z * (1.1881525421101212e-20 + z * series))


def sine(x: float) -> float:
    """Return the sine of an angle in degrees; NaN of an infinite one. A zero has the sign of the angle."""
    if x - x != 0.0:
        return nan
    turned = fmod(x, 360.0)
    quarters = round(turned / 90.0)
    rest = turned - 90.0 * quarters
    if quarters & 1:
        value = cosine_near_zero(rest)
    elif rest == 0.0:
        return copysign(0.0, x)
    elif -1e-200 < rest < 1e-200:
        return scaled_to_radians(rest)  # so small an angle is its own rest
    else:
        value = sine_near_zero(rest)
    return -value if quarters & 2 else value


def cosine(x: float) -> float:
    """Return the cosine of an angle in degrees; NaN of an infinite one. Zeros are positive."""
    if x - x != 0.0:
        return nan
    turned = fmod(x, 360.0)
    quarters = round(turned / 90.0)
    rest = turned - 90.0 * quarters
    if quarters & 1:
        if rest == 0.0:
            return 0.0
        return -sine_near_zero(rest) if (quarters & 2) == 0 else sine_near_zero(rest)
    return -cosine_near_zero(rest) if quarters & 2 else cosine_near_zero(rest)


def tangent(x: float) -> float:
    """Return the tangent of an angle in degrees; NaN of an infinite one.

    At 90 deg + k * 180 deg it is inf for even k and -inf for odd k. A zero has the sign of the angle.
    """
    if not isfinite(x):
        return nan
    quarter, rest = quarters_and_rest(x)
    if rest == 0.0:
        return (copysign(0.0, x), inf, copysign(0.0, x), -inf)[quarter]
    if abs(rest) < 1e-200:
        return scaled_to_radians(rest)
    above, above_error = sine_of_rest(rest)
    below, below_error = cosine_of_rest(rest)
    if quarter & 1:
        above, above_error, below, below_error = -below, -below_error, above, above_error
    value, error = quotient(above, above_error, below, below_error)
    return value + error


def scaled_to_radians(x: float) -> float:
    """Return degrees in radians for angles so small that products of their parts would be lost."""
    high, low = in_radians(ldexp(x, 600))
    return ldexp(high + low, -600)


def quotient(x: float, x_error: float, y: float, y_error: float) -> tuple[float, float]:
    """Return the quotient of two sums of two floats, as one; neither is near the ends of the floats."""
    value, error, _ = quotient_and_high(x, x_error, y, y_error)
    return value, error


def quotient_and_high(x: float, x_error: float, y: float, y_error: float) -> tuple[float, float, float]:
    """Return the quotient of two sums of two floats, as one, and the high half of its first float."""
    value = x / y
    scaled = 134217729.0 * value
    high = scaled - (scaled - value)
    low = value - high
    scaled = 134217729.0 * y
    y_high = scaled - (scaled - y)
    y_low = y - y_high
    product = value * y
    product_error = low * y_low - (((product - high * y_high) - low * y_high) - high * y_low)
    return value, ((x - product) - product_error + x_error - value * y_error) / y, high


def arc(y: float, y_error: float, x: float, x_error: float) -> tuple[float, float]:
    """Return the angle of the direction (x, y), 0 <= y <= x, 0 < x, in degrees as a sum of two floats."""
    t, t_error, t_high = quotient_and_high(y, y_error, x, x_error)
    sixteenths = round(16.0 * t)
    part = 0.0625 * sixteenths
    begin, begin_error = (
        (0.0, 0.0),
        (3.576334374997351, -4.254839715196495e-17),
        (7.125016348901798, -1.2948639595014213e-16),
        (10.619655276155134, 3.9353821206767933e-16),
        (14.036243467926479, -1.178545638282857e-16),
        (17.35402463626132, 2.629325578208967e-16),
        (20.556045219583464, 7.735753643362621e-16),
        (23.629377730656817, -3.857270537916843e-17),
        (26.56505117707799, -6.673432494950659e-16),
        (29.357753542791272, 3.183231713449758e-16),
        (32.005383208083494, 1.8761647814886433e-15),
        (34.5085229876684, 1.6654005518742188e-15),
        (36.86989764584402, 1.3346864989901319e-15),
        (39.0938588862295, 2.335881743638655e-15),
        (41.18592516570965, -2.0942594695766676e-15),
        (43.1523897340054, 8.502900827062482e-16),
        (45.0, 0.0),
    )[sixteenths]
    product = part * t_high  # exact: `part` has few bits
    rough = 1.0 + product
    rest = (product - (rough - 1.0)) + part * (t - t_high + t_error)
    below = rough + rest
    below_error = (rough - below) + rest
    # atan(t) = atan(part) + atan(u), and u is at most 1/32
    u, u_error, u_high = quotient_and_high(t - part, t_error, below, below_error)
    z = u * u
    series = 0.07692307692307693
    series = -0.09090909090909091 + z * series
    series = 0.1111111111111111 + z * series
    series = -0.14285714285714285 + z * series
    series = 0.2 + z * series
    series = -0.3333333333333333 + z * series
    rest_error = u * (z * series) + u_error * (1.0 - z)
    rest = u_high * 57.29577922821045  # exact: both have 26 bits
    degrees_error = (u - u_high) * 57.29577922821045 + u * 2.8487187165804814e-07
    value = begin + rest
    error = (rest - (value - begin)) + begin_error
    return value, error + (degrees_error + rest_error * 57.29577951308232)


def direction(y: float, x: float) -> float:
    """Return `atan2(y, x)` in degrees, in -180 .. 180, but 0 of (0, 0), with the sign of `y`.

    NaN if either is.
    """
    above, beside = abs(y), abs(x)
    if not (1e-100 < above < 1e100 and 1e-100 < beside < 1e100):
        return direction_of_extremes(y, x)
    if above <= beside:
        value, error = arc(above, 0.0, beside, 0.0)
    else:
        value, error = arc(beside, 0.0, above, 0.0)
        value, error = supplement(90.0, value, error)
    if x < 0.0:
        value, error = supplement(180.0, value, error)
    return copysign(value + error, y)


def direction_of_extremes(y: float, x: float) -> float:
    """Return `direction(y, x)`, whatever the size of its arguments."""
    if y != y or x != x:
        return nan
    if y == 0.0:
        return 0.0 if x == 0.0 else copysign(180.0 if x < 0.0 else 0.0, y)
    if isinf(x) or isinf(y):
        return copysign(
            (135.0 if x < 0.0 else 45.0)
            if isinf(x) and isinf(y)
            else 90.0
            if isinf(y)
            else 180.0
            if x < 0.0
            else 0.0,
            y,
        )
    value, error = angle_between(abs(y), 0.0, abs(x), 0.0)
    if x < 0.0:
        value, error = supplement(180.0, value, error)
    return copysign(value + error, y)


def supplement(whole: float, value: float, error: float) -> tuple[float, float]:
    """Return what an angle, as a sum of two floats, lacks to `whole`, which is above it."""
    rest = whole - value
    return rest, (whole - rest) - value - error


def angle_between(y: float, y_error: float, x: float, x_error: float) -> tuple[float, float]:
    """Return the angle of the direction (x, y), with 0 <= x and 0 <= y, not both zero, in 0 .. 90 degrees."""
    if y > x:
        value, error = angle_between(x, x_error, y, y_error)
        return supplement(90.0, value, error)
    shift = frexp(x)[1]
    if y < 1e-20 * x:  # its tangent is the angle; the scale comes last, since the angle may be very small
        y_shift = frexp(y)[1]
        t, t_error = quotient(
            ldexp(y, -y_shift), ldexp(y_error, -y_shift), ldexp(x, -shift), ldexp(x_error, -shift)
        )
        value, error = product_and_error(t, 57.29577951308232)
        error += t_error * 57.29577951308232 - t * 1.9878495670576283e-15
        return ldexp(value + error, y_shift - shift), 0.0
    return arc(ldexp(y, -shift), ldexp(y_error, -shift), ldexp(x, -shift), ldexp(x_error, -shift))


def other_leg(x: float) -> tuple[float, float]:
    """Return the square root of 1 - x * x, for 0 <= x <= 1, as a sum of two floats."""
    less = 1.0 - x
    less_error = (1.0 - less) - x
    more = 1.0 + x
    more_error = (1.0 - more) + x
    square, error = product_and_error(less, more)
    error += less * more_error + less_error * more
    if square == 0.0:
        return 0.0, 0.0
    root = sqrt(square)
    again, again_error = product_and_error(root, root)
    return root, ((square - again) - again_error + error) / (2.0 * root)


def arc_sine(x: float) -> float:
    """Return the angle in -90 .. 90 degrees whose sine is `x`; NaN outside -1 .. 1."""
    size = abs(x)
    if not size <= 1.0:
        return nan
    leg, leg_error = other_leg(size)
    value, error = angle_between(size, 0.0, leg, leg_error)
    return copysign(value + error, x)


def arc_cosine(x: float) -> float:
    """Return the angle in 0 .. 180 degrees whose cosine is `x`; NaN outside -1 .. 1."""
    size = abs(x)
    if not size <= 1.0:
        return nan
    leg, leg_error = other_leg(size)
    value, error = angle_between(leg, leg_error, size, 0.0)
    if x < 0.0:
        value, error = supplement(180.0, value, error)
    return value + error
