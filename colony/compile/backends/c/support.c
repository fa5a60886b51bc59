/* The functions that generated programs use. Each program includes those that it needs. */

/* The reading's status at `t_ns`: lost if it was taken more than `within_ns` before, faulty if after. */
static int colony_aged(int given, int64_t t_ns, int64_t taken_ns, int64_t within_ns)
{
    if (given != COLONY_GIVEN) {
        return given;
    }
    if (taken_ns > t_ns) {
        return COLONY_FAULTY;
    }
    return (uint64_t)t_ns - (uint64_t)taken_ns > (uint64_t)within_ns ? COLONY_LOST : COLONY_GIVEN;
}

/* What is found of a reading that is not given, or not valid. */
static uint8_t colony_unread(int given)
{
    return given == COLONY_ABSENT || given == COLONY_LOST ? COLONY_MISSING : COLONY_FAULT;
}

/* Take a number in its declared unit: `value` is in base units and clamped, or `otherwise`. True if fresh. */
static bool colony_number(double *value, uint8_t *found, int given, double reading, double factor, double low,
                          double high, double otherwise)
{
    if (given != COLONY_GIVEN || reading != reading) {
        *value = otherwise;
        *found = colony_unread(given);
        return false;
    }
    const double x = reading * factor;
    *value = x < low ? low : x > high ? high : x;
    *found = *value == x ? COLONY_FRESH : COLONY_CLAMPED;
    return true;
}

/* Take an array of numbers; it is faulty if one of them is NaN. */
static bool colony_numbers(double *values, uint8_t *found, int given, const double *reading, int size,
                           double factor, double low, double high, double otherwise)
{
    *found = colony_unread(given);
    if (given == COLONY_GIVEN) {
        *found = COLONY_FRESH;
        for (int i = 0; i < size; i++) {
            const double x = reading[i] * factor;
            if (reading[i] != reading[i]) {
                *found = COLONY_FAULT;
                break;
            }
            values[i] = x < low ? low : x > high ? high : x;
            if (values[i] != x) {
                *found = COLONY_CLAMPED;
            }
        }
    }
    if (*found == COLONY_FRESH || *found == COLONY_CLAMPED) {
        return true;
    }
    for (int i = 0; i < size; i++) {
        values[i] = otherwise;
    }
    return false;
}

/* True if a number is one of those of an enum. */
static bool colony_listed(double number, const double *members, int count)
{
    for (int i = 0; i < count; i++) {
        if (number == members[i]) {
            return true;
        }
    }
    return false;
}

/* Take a member of an enum. */
static bool colony_member(double *value, uint8_t *found, int given, double reading, const double *members,
                          int count, double otherwise)
{
    const bool is_fresh = given == COLONY_GIVEN && colony_listed(reading, members, count);
    *value = is_fresh ? reading : otherwise;
    *found = is_fresh ? COLONY_FRESH : colony_unread(given);
    return is_fresh;
}

/* Take an array of members of an enum; it is faulty if one of them is none. */
static bool colony_members(double *values, uint8_t *found, int given, const double *reading, int size,
                           const double *members, int count, double otherwise)
{
    bool is_fresh = given == COLONY_GIVEN;
    for (int i = 0; i < size && is_fresh; i++) {
        is_fresh = colony_listed(reading[i], members, count);
    }
    for (int i = 0; i < size; i++) {
        values[i] = is_fresh ? reading[i] : otherwise;
    }
    *found = is_fresh ? COLONY_FRESH : colony_unread(given);
    return is_fresh;
}

/* Take a bool. */
static bool colony_bool(bool *value, uint8_t *found, int given, bool reading, bool otherwise)
{
    const bool is_fresh = given == COLONY_GIVEN;
    *value = is_fresh ? reading : otherwise;
    *found = is_fresh ? COLONY_FRESH : colony_unread(given);
    return is_fresh;
}

/* Take an array of bools. */
static bool colony_bools(bool *values, uint8_t *found, int given, const bool *reading, int size, bool otherwise)
{
    const bool is_fresh = given == COLONY_GIVEN;
    for (int i = 0; i < size; i++) {
        values[i] = is_fresh ? reading[i] : otherwise;
    }
    *found = is_fresh ? COLONY_FRESH : colony_unread(given);
    return is_fresh;
}

/* Bound a field of a command; a bound that is the range's is a clamp. */
static uint8_t colony_bounded(double *value, double low, double high, double least, double most)
{
    if (*value < low) {
        *value = low;
        return low == least ? COLONY_RANGE : COLONY_LIMITED;
    }
    if (*value > high) {
        *value = high;
        return high == most ? COLONY_RANGE : COLONY_LIMITED;
    }
    return COLONY_UNCHANGED;
}

/* False for infinities and NaN. */
static bool colony_finite(double x)
{
    return x - x == 0.0;
}

/* The lesser of two numbers, the first of equals; NaN if either is NaN, which fmin does not give. */
static double colony_min(double x, double y)
{
    if (x != x || y != y) {
        return (double)NAN;
    }
    return y < x ? y : x;
}

/* The greater of two numbers, the first of equals; NaN if either is NaN. */
static double colony_max(double x, double y)
{
    if (x != x || y != y) {
        return (double)NAN;
    }
    return y > x ? y : x;
}

/* The least number, the first of equals; NaN if one is NaN. */
static double colony_least(const double *x, int size)
{
    double least = x[0];
    for (int i = 0; i < size; i++) {
        if (x[i] != x[i]) {
            return (double)NAN;
        }
        if (x[i] < least) {
            least = x[i];
        }
    }
    return least;
}

/* The greatest number, the first of equals; NaN if one is NaN. */
static double colony_greatest(const double *x, int size)
{
    double greatest = x[0];
    for (int i = 0; i < size; i++) {
        if (x[i] != x[i]) {
            return (double)NAN;
        }
        if (x[i] > greatest) {
            greatest = x[i];
        }
    }
    return greatest;
}

/* The sum from left to right, beginning with the first number. */
static double colony_total(const double *x, int size)
{
    double sum = x[0];
    for (int i = 1; i < size; i++) {
        sum = sum + x[i];
    }
    return sum;
}

/* The number of true values. */
static double colony_count(const bool *x, int size)
{
    int count = 0;
    for (int i = 0; i < size; i++) {
        count += x[i] ? 1 : 0;
    }
    return (double)count;
}

/* The index of the least number, the first of equals; any number beats NaN; 0 if all are NaN. */
static double colony_index_of_min(const double *x, int size)
{
    int best = 0;
    for (int i = 1; i < size; i++) {
        if (x[i] < x[best] || (x[best] != x[best] && x[i] == x[i])) {
            best = i;
        }
    }
    return (double)best;
}

/* The index of the greatest number, the first of equals; any number beats NaN; 0 if all are NaN. */
static double colony_index_of_max(const double *x, int size)
{
    int best = 0;
    for (int i = 1; i < size; i++) {
        if (x[i] > x[best] || (x[best] != x[best] && x[i] == x[i])) {
            best = i;
        }
    }
    return (double)best;
}

/* An index rounded (halves to even) and taken modulo the size. */
static int colony_index(int size, double index)
{
    const double rest = fmod(nearbyint(index), (double)size);
    return (int)(rest < 0.0 ? rest + (double)size : rest);
}

/* The element at an index; NaN if the index is not finite. */
static double colony_pick_number(const double *x, int size, double index)
{
    return colony_finite(index) ? x[colony_index(size, index)] : (double)NAN;
}

/* The element at an index; false if the index is not finite. */
static bool colony_pick_bool(const bool *x, int size, double index)
{
    return colony_finite(index) && x[colony_index(size, index)];
}

/* The remainder with the sign of `y`; NaN for y = 0. */
static double colony_modulo(double x, double y)
{
    if (y == 0.0) {
        return (double)NAN;
    }
    const double rest = fmod(x, y);
    if (rest == 0.0) {
        return copysign(0.0, y);
    }
    return (y < 0.0) != (rest < 0.0) ? rest + y : rest;
}

/* The square root: NaN of a negative number. */
static double colony_sqrt(double x)
{
    return x < 0.0 ? (double)NAN : sqrt(x);
}

/* 1, -1, or 0 of either zero; NaN of NaN. */
static double colony_sign(double x)
{
    return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x == x ? 0.0 : x;
}

/* A sum of two numbers, the second the rounding error of the first. */
struct colony_pair {
    double value;
    double error;
};

/* A pair. */
static struct colony_pair colony_pair_of(double value, double error)
{
    const struct colony_pair pair = {value, error};
    return pair;
}

/* The high half of the bits of a number of moderate size. */
static double colony_high(double x)
{
    const double scaled = 134217729.0 * x;
    return scaled - (scaled - x);
}

/* The exact product of two numbers of moderate size (Dekker 1971). */
static struct colony_pair colony_product(double x, double y)
{
    const double product = x * y;
    const double x_high = colony_high(x);
    const double x_low = x - x_high;
    const double y_high = colony_high(y);
    const double y_low = y - y_high;
    return colony_pair_of(product,
                          x_low * y_low - (((product - x_high * y_high) - x_low * y_high) - x_high * y_low));
}

/* The nearest multiple of 90 degrees, by its number modulo 4. */
static int colony_quarters(double turned)
{
    return ((int)nearbyint(turned / 90.0) + 4) & 3;
}

/* The rest of an angle beyond the nearest multiple of 90 degrees, exactly: at most 45. */
static double colony_rest(double turned)
{
    return turned - 90.0 * nearbyint(turned / 90.0);
}

/* At most 45 degrees in radians. */
static struct colony_pair colony_radians(double x)
{
    const struct colony_pair product = colony_product(x, 0.017453292519943295);
    return colony_pair_of(product.value, product.error + x * 2.9486522708701687e-19);
}

/* Degrees in radians, for angles so small that products of their parts would be lost. */
static double colony_small_radians(double x)
{
    const struct colony_pair radians = colony_radians(ldexp(x, 600));
    return ldexp(radians.value + radians.error, -600);
}

/* The sine of at most 45 degrees, for quotients. */
static struct colony_pair colony_sine_of_rest(double x)
{
    const struct colony_pair radians = colony_radians(x);
    const double high = radians.value;
    const double z = high * high;
    double series = 2.8114572543455206e-15;
    series = -7.647163731819816e-13 + z * series;
    series = 1.6059043836821613e-10 + z * series;
    series = -2.505210838544172e-08 + z * series;
    series = 2.7557319223985893e-06 + z * series;
    series = -0.0001984126984126984 + z * series;
    series = 0.008333333333333333 + z * series;
    series = -0.16666666666666666 + z * series;
    series = high * (z * series) + radians.error * (1.0 - 0.5 * z);
    const double value = high + series;
    return colony_pair_of(value, (high - value) + series);
}

/* The cosine of at most 45 degrees, for quotients. */
static struct colony_pair colony_cosine_of_rest(double x)
{
    const struct colony_pair radians = colony_radians(x);
    const struct colony_pair square = colony_product(radians.value, radians.value);
    const double z = square.value;
    const double half = 0.5 * z;
    const double value = 1.0 - half;
    double series = -1.5619206968586225e-16;
    series = 4.779477332387385e-14 + z * series;
    series = -1.1470745597729725e-11 + z * series;
    series = 2.08767569878681e-09 + z * series;
    series = -2.755731922398589e-07 + z * series;
    series = 2.48015873015873e-05 + z * series;
    series = -0.001388888888888889 + z * series;
    series = 0.041666666666666664 + z * series;
    series = ((1.0 - value) - half) + (z * (z * series) - 0.5 * square.error - radians.value * radians.error);
    const double rounded = value + series;
    return colony_pair_of(rounded, (value - rounded) + series);
}

/* The sine of at most 45 degrees. */
static double colony_sine_near_zero(double x)
{
    const double high = colony_high(x);
    const double z = x * x;
    double series = -1.1467754740637923e-27 + z * 2.2197180143346243e-33;
    series = -9.788384859392164e-17 + z * (4.141266948173571e-22 + z * series);
    series = -8.860961557012979e-07 + z * (1.3496016231628688e-11 + z * series);
    const double low = (x - high) * 0.01745329238474369 + x * 1.3519960527851425e-10;
    return high * 0.01745329238474369 + (low + x * (z * series));
}

/* The cosine of at most 45 degrees. */
static double colony_cosine_near_zero(double x)
{
    const double z = x * x;
    double series = 1.6679335411070536e-30 + z * -2.770293977358139e-36;
    series = 2.1354943033520361e-19 + z * (-7.227874651622457e-25 + z * series);
    series = 3.866323851562994e-09 + z * (-3.9258319857426733e-14 + z * series);
    const double square = z * 0.0001523087098933543;
    const double value = 1.0 - square;
    return value + (((1.0 - value) - square) + z * (1.1881525421101212e-20 + z * series));
}

/* The sine of an angle in degrees; a zero has the sign of the angle. */
static double colony_sin(double x)
{
    if (!colony_finite(x)) {
        return (double)NAN;
    }
    const double turned = fmod(x, 360.0);
    const int quarters = colony_quarters(turned);
    const double rest = colony_rest(turned);
    double value;
    if ((quarters & 1) != 0) {
        value = colony_cosine_near_zero(rest);
    } else if (rest == 0.0) {
        return copysign(0.0, x);
    } else if (-1e-200 < rest && rest < 1e-200) {
        return colony_small_radians(rest);
    } else {
        value = colony_sine_near_zero(rest);
    }
    return (quarters & 2) != 0 ? -value : value;
}

/* The cosine of an angle in degrees; zeros are positive. */
static double colony_cos(double x)
{
    if (!colony_finite(x)) {
        return (double)NAN;
    }
    const double turned = fmod(x, 360.0);
    const int quarters = colony_quarters(turned);
    const double rest = colony_rest(turned);
    if ((quarters & 1) != 0) {
        if (rest == 0.0) {
            return 0.0;
        }
        return (quarters & 2) == 0 ? -colony_sine_near_zero(rest) : colony_sine_near_zero(rest);
    }
    return (quarters & 2) != 0 ? -colony_cosine_near_zero(rest) : colony_cosine_near_zero(rest);
}

/* The quotient of two pairs, neither near the ends of the doubles. */
static struct colony_pair colony_quotient(struct colony_pair x, struct colony_pair y)
{
    const double value = x.value / y.value;
    const struct colony_pair product = colony_product(value, y.value);
    return colony_pair_of(value,
                          ((x.value - product.value) - product.error + x.error - value * y.error) / y.value);
}

/* The tangent of an angle in degrees: infinite at 90 and, with a minus, at 270. */
static double colony_tan(double x)
{
    if (!colony_finite(x)) {
        return (double)NAN;
    }
    const double turned = fmod(x, 360.0);
    const int quarter = colony_quarters(turned);
    const double rest = colony_rest(turned);
    if (rest == 0.0) {
        return (quarter & 1) == 0 ? copysign(0.0, x) : quarter == 1 ? (double)INFINITY : -(double)INFINITY;
    }
    if (fabs(rest) < 1e-200) {
        return colony_small_radians(rest);
    }
    struct colony_pair above = colony_sine_of_rest(rest);
    struct colony_pair below = colony_cosine_of_rest(rest);
    if ((quarter & 1) != 0) {
        const struct colony_pair sine = above;
        above = colony_pair_of(-below.value, -below.error);
        below = sine;
    }
    const struct colony_pair value = colony_quotient(above, below);
    return value.value + value.error;
}

/* The angle of the direction (x, y) in degrees, 0 <= y <= x, 0 < x. */
static struct colony_pair colony_arc(struct colony_pair y, struct colony_pair x)
{
    static const double begins[17][2] = {
        {0.0, 0.0},
        {3.576334374997351, -4.254839715196495e-17},
        {7.125016348901798, -1.2948639595014213e-16},
        {10.619655276155134, 3.9353821206767933e-16},
        {14.036243467926479, -1.178545638282857e-16},
        {17.35402463626132, 2.629325578208967e-16},
        {20.556045219583464, 7.735753643362621e-16},
        {23.629377730656817, -3.857270537916843e-17},
        {26.56505117707799, -6.673432494950659e-16},
        {29.357753542791272, 3.183231713449758e-16},
        {32.005383208083494, 1.8761647814886433e-15},
        {34.5085229876684, 1.6654005518742188e-15},
        {36.86989764584402, 1.3346864989901319e-15},
        {39.0938588862295, 2.335881743638655e-15},
        {41.18592516570965, -2.0942594695766676e-15},
        {43.1523897340054, 8.502900827062482e-16},
        {45.0, 0.0},
    };
    const struct colony_pair t = colony_quotient(y, x);
    const double t_high = colony_high(t.value);
    const int sixteenths = (int)nearbyint(16.0 * t.value);
    const double part = 0.0625 * (double)sixteenths;
    const double begin = begins[sixteenths][0];
    const double product = part * t_high; /* exact: `part` has few bits */
    const double rough = 1.0 + product;
    const double rest = (product - (rough - 1.0)) + part * (t.value - t_high + t.error);
    const double below = rough + rest;
    /* atan(t) = atan(part) + atan(u), and u is at most 1/32 */
    const struct colony_pair u =
        colony_quotient(colony_pair_of(t.value - part, t.error), colony_pair_of(below, (rough - below) + rest));
    const double u_high = colony_high(u.value);
    const double z = u.value * u.value;
    double series = 0.07692307692307693;
    series = -0.09090909090909091 + z * series;
    series = 0.1111111111111111 + z * series;
    series = -0.14285714285714285 + z * series;
    series = 0.2 + z * series;
    series = -0.3333333333333333 + z * series;
    const double rest_error = u.value * (z * series) + u.error * (1.0 - z);
    const double degrees = u_high * 57.29577922821045; /* exact: both have 26 bits */
    const double degrees_error = (u.value - u_high) * 57.29577922821045 + u.value * 2.8487187165804814e-07;
    const double value = begin + degrees;
    const double error = (degrees - (value - begin)) + begins[sixteenths][1];
    return colony_pair_of(value, error + (degrees_error + rest_error * 57.29577951308232));
}

/* What an angle lacks to `whole`, which is above it. */
static struct colony_pair colony_supplement(double whole, struct colony_pair angle)
{
    const double rest = whole - angle.value;
    return colony_pair_of(rest, (whole - rest) - angle.value - angle.error);
}

/* The fraction of a number, and its exponent. */
static struct colony_pair colony_scaled(struct colony_pair x, int shift)
{
    return colony_pair_of(ldexp(x.value, -shift), ldexp(x.error, -shift));
}

/* The binary exponent of a number. */
static int colony_exponent(double x)
{
    int exponent = 0;
    (void)frexp(x, &exponent);
    return exponent;
}

/* The angle of the direction (x, y), 0 <= y <= x, 0 < x, whatever their sizes. */
static struct colony_pair colony_narrow_angle(struct colony_pair y, struct colony_pair x)
{
    const int shift = colony_exponent(x.value);
    if (y.value < 1e-20 * x.value) { /* its tangent is the angle; the scale comes last */
        const int y_shift = colony_exponent(y.value);
        const struct colony_pair t = colony_quotient(colony_scaled(y, y_shift), colony_scaled(x, shift));
        const struct colony_pair degrees = colony_product(t.value, 57.29577951308232);
        const double error = degrees.error + (t.error * 57.29577951308232 - t.value * 1.9878495670576283e-15);
        return colony_pair_of(ldexp(degrees.value + error, y_shift - shift), 0.0);
    }
    return colony_arc(colony_scaled(y, shift), colony_scaled(x, shift));
}

/* The angle of the direction (x, y), 0 <= x, 0 <= y, not both zero, in 0 .. 90 degrees. */
static struct colony_pair colony_angle_between(struct colony_pair y, struct colony_pair x)
{
    if (y.value > x.value) {
        return colony_supplement(90.0, colony_narrow_angle(x, y));
    }
    return colony_narrow_angle(y, x);
}

/* The angle of (y, x) in degrees, in -180 .. 180, with the sign of `y`, whatever the sizes. */
static double colony_atan2_of_extremes(double y, double x)
{
    if (y != y || x != x) {
        return (double)NAN;
    }
    if (y == 0.0) {
        return x == 0.0 ? 0.0 : copysign(x < 0.0 ? 180.0 : 0.0, y);
    }
    const bool wide = !colony_finite(x);
    const bool high = !colony_finite(y);
    if (wide || high) {
        const double diagonal = x < 0.0 ? 135.0 : 45.0;
        return copysign(wide && high ? diagonal : high ? 90.0 : x < 0.0 ? 180.0 : 0.0, y);
    }
    struct colony_pair angle = colony_angle_between(colony_pair_of(fabs(y), 0.0), colony_pair_of(fabs(x), 0.0));
    if (x < 0.0) {
        angle = colony_supplement(180.0, angle);
    }
    return copysign(angle.value + angle.error, y);
}

/* The angle of (y, x) in degrees, in -180 .. 180, but 0 of (0, 0), with the sign of `y`. */
static double colony_atan2(double y, double x)
{
    const struct colony_pair above = colony_pair_of(fabs(y), 0.0);
    const struct colony_pair beside = colony_pair_of(fabs(x), 0.0);
    if (!(1e-100 < above.value && above.value < 1e100 && 1e-100 < beside.value && beside.value < 1e100)) {
        return colony_atan2_of_extremes(y, x);
    }
    struct colony_pair angle;
    if (above.value <= beside.value) {
        angle = colony_arc(above, beside);
    } else {
        angle = colony_supplement(90.0, colony_arc(beside, above));
    }
    if (x < 0.0) {
        angle = colony_supplement(180.0, angle);
    }
    return copysign(angle.value + angle.error, y);
}

/* The square root of 1 - x * x, for 0 <= x <= 1. */
static struct colony_pair colony_other_leg(double x)
{
    const double less = 1.0 - x;
    const double less_error = (1.0 - less) - x;
    const double more = 1.0 + x;
    const double more_error = (1.0 - more) + x;
    const struct colony_pair square = colony_product(less, more);
    const double error = square.error + (less * more_error + less_error * more);
    if (square.value == 0.0) {
        return colony_pair_of(0.0, 0.0);
    }
    const double root = sqrt(square.value);
    const struct colony_pair again = colony_product(root, root);
    return colony_pair_of(root, ((square.value - again.value) - again.error + error) / (2.0 * root));
}

/* The angle in -90 .. 90 degrees that has the sine `x`; NaN outside -1 .. 1. */
static double colony_asin(double x)
{
    const double size = fabs(x);
    if (!(size <= 1.0)) {
        return (double)NAN;
    }
    const struct colony_pair angle = colony_angle_between(colony_pair_of(size, 0.0), colony_other_leg(size));
    return copysign(angle.value + angle.error, x);
}

/* The angle in 0 .. 180 degrees that has the cosine `x`; NaN outside -1 .. 1. */
static double colony_acos(double x)
{
    const double size = fabs(x);
    if (!(size <= 1.0)) {
        return (double)NAN;
    }
    struct colony_pair angle = colony_angle_between(colony_other_leg(size), colony_pair_of(size, 0.0));
    if (x < 0.0) {
        angle = colony_supplement(180.0, angle);
    }
    return angle.value + angle.error;
}
