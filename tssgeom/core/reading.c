#include "core.h"

#include <string.h>

static const double POWERS_OF_TEN[] = { /* exact in float64 */
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11,
    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22 };
static const int64_t HIGHEST_POWER = 22;
static const int64_t EXACT = (int64_t)1 << 53;        /* whole numbers up to here are exact in float64 */
static const int64_t MOST_WHOLE = 900000000000000000; /* int64 holds one digit more */
static const double SPLIT = 134217729.0;              /* 2^27 + 1 cuts a number into two halves */
static const double TIE = 1.0 - 1e-6; /* of half the last digit: beyond it, either neighbour may be nearest */

typedef struct {
    const char *at, *end;
} Cursor;

static void skip_blank(Cursor *c) {
    while (c->at < c->end && (*c->at == ' ' || *c->at == '\t' || *c->at == '\n' || *c->at == '\r')) c->at++;
}

/* Go past a character; 0 where there is another one, or none. */
static int take(Cursor *c, char wanted) {
    if (c->at == c->end || *c->at != wanted) return 0;
    c->at++;
    return 1;
}

/* Append digits to a whole number until it is too large for one more. */
static int64_t read_digits(Cursor *c, int64_t whole) {
    for (; c->at < c->end && *c->at >= '0' && *c->at <= '9' && whole < MOST_WHOLE; c->at++)
        whole = 10 * whole + (*c->at - '0');
    return whole;
}

/* Product of two numbers and its rounding error, both exact (Dekker). */
static double product_of(double a, double b, double *error) {
    double high = SPLIT * a, other = SPLIT * b;
    double a1 = high - (high - a), b1 = other - (other - b), a2 = a - a1, b2 = b - b1;
    double product = a * b;
    *error = a2 * b2 - (((product - a1 * b1) - a2 * b1) - a1 * b2);
    return product;
}

/* whole / 10^decimals rounded to the nearest number; NaN where two may be equally near. */
static double nearest_to(int64_t whole, int64_t decimals) {
    double head = (double)whole, tail = (double)(whole - (int64_t)head), error;
    if (whole <= EXACT)
        return decimals >= 0 ? head / POWERS_OF_TEN[decimals] : head * POWERS_OF_TEN[-decimals];
    if (decimals < 0) return NAN;
    double power = POWERS_OF_TEN[decimals], share = head / power, product = product_of(share, power, &error);
    double more = (((head - product) - error) + tail) / power, value = share + more;
    double left = (share - value) + more; /* what value lacks */
    int exponent;
    double mantissa = frexp(value, &exponent);
    return mantissa == 0.5 || fabs(left) > TIE * ldexp(1.0, exponent - 54) ? NAN : value;
}

static int read_number(Cursor *c, double *value) {
    int negative = take(c, '-');
    const char *first = c->at;
    int64_t whole = read_digits(c, 0), decimals = 0;
    if (c->at == first || (*first == '0' && c->at > first + 1)) return 0;
    if (take(c, '.')) {
        first = c->at;
        whole = read_digits(c, whole);
        decimals = c->at - first;
        if (decimals == 0) return 0;
    }
    if (take(c, 'e') || take(c, 'E')) {
        int smaller = take(c, '-');
        if (!smaller) take(c, '+');
        first = c->at;
        int64_t power = read_digits(c, 0);
        if (c->at == first || c->at > first + 3) return 0;
        decimals += smaller ? power : -power;
    }
    if (whole >= MOST_WHOLE || decimals < -HIGHEST_POWER || decimals > HIGHEST_POWER) return 0;
    double size = nearest_to(whole, decimals);
    *value = negative ? -size : size;
    return !isnan(size);
}

static int read_null(Cursor *c, double row[3]) {
    if (c->end - c->at < 4 || memcmp(c->at, "null", 4) != 0) return 0;
    c->at += 4;
    row[0] = row[1] = row[2] = NAN;
    return 1;
}

static int read_row(Cursor *c, double row[3]) {
    for (int k = 0; k < 3; k++) {
        if (!take(c, k ? ',' : '[')) return 0;
        skip_blank(c);
        if (!read_number(c, &row[k])) return 0;
        skip_blank(c);
    }
    return take(c, ']');
}

/** Read `[[x,y,z],null,…]` of JSON: points, a row of NaN for a null.

Parameters: the text [n]; memory for the points [most][3], in the text's unit; most = n / 5 + 1 is enough.
Returns how many points there are: 0 where the text is anything else, or has a number that is hard to round.
Each number is the nearest float64, as the JSON library gives it. */
ENTRY int64_t tss_read_points(int64_t n, const char text[n], int64_t most, INOUT double points[most][3]) {
    Cursor c = { text, text + n };
    int64_t count = 0;
    skip_blank(&c);
    if (!take(&c, '[')) return 0;
    do {
        skip_blank(&c);
        if (count == most || !(read_null(&c, points[count]) || read_row(&c, points[count]))) return 0;
        count++;
        skip_blank(&c);
    } while (take(&c, ','));
    if (!take(&c, ']')) return 0;
    skip_blank(&c);
    return c.at == c.end ? count : 0;
}
