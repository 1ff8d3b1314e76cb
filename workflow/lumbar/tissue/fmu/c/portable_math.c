/* Elementary functions from additions, multiplications and divisions alone, each correct to about one unit in the
 * last place. expm1, log1p, arctan and the kernels of sine and cosine are those of FreeBSD's msun (s_expm1.c,
 * s_log1p.c, s_atan.c, k_sin.c, k_cos.c), which carry this notice:
 *
 * Copyright (C) 1993 by Sun Microsystems, Inc. All rights reserved.
 * Developed at SunSoft, a Sun Microsystems, Inc. business.
 * Permission to use, copy, modify, and distribute this software is freely granted, provided that this notice is
 * preserved.
 */
#include "portable_math.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

static const double LN2_HIGH = 6.93147180369123816490e-01, LN2_LOW = 1.90821492927058770002e-10;

/* 2^k for -1022 <= k <= 1023. */
static double power_of_two(int k) {
    uint64_t bits = (uint64_t)(0x3ff + k) << 52;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

INLINED double portable_expm1(double x) {
    static const double LARGEST = 7.09782712893383973096e+02, INVERSE_LN2 = 1.44269504088896338700e+00,
                        Q1 = -3.33333333333331316428e-02, Q2 = 1.58730158725481460165e-03,
                        Q3 = -7.93650757867487942473e-05, Q4 = 4.00821782732936239552e-06,
                        Q5 = -2.01099218183624371326e-07;
    if (isnan(x)) return x;
    if (x > LARGEST) return INFINITY;
    if (x < -56.0 * LN2_HIGH) return -1.0;
    if (fabs(x) < 0x1p-54) return x;
    int k = 0;
    double c = 0.0;
    if (fabs(x) > 0.5 * LN2_HIGH) {
        k = (int)(INVERSE_LN2 * x + (x < 0 ? -0.5 : 0.5));
        double high = x - k * LN2_HIGH, low = k * LN2_LOW;
        x = high - low;
        c = (high - x) - low;
    }
    double half = 0.5 * x, square = x * half;
    double r = 1.0 + square * (Q1 + square * (Q2 + square * (Q3 + square * (Q4 + square * Q5))));
    double t = 3.0 - r * half;
    double e = square * ((r - t) / (6.0 - x * t));
    if (k == 0) return x - (x * e - square);
    e = x * (e - c) - c;
    e -= square;
    if (k == -1) return 0.5 * (x - e) - 0.5;
    if (k == 1) return x < -0.25 ? -2.0 * (e - (x + 0.5)) : 1.0 + 2.0 * (x - e);
    if (k < 0 || k > 56) {
        double y = x - e + 1.0;
        return (k == 1024 ? y * 2.0 * 0x1p1023 : y * power_of_two(k)) - 1.0;
    }
    if (k < 20) return (x - e + (1.0 - power_of_two(-k))) * power_of_two(k);
    return (x - (e + power_of_two(-k)) + 1.0) * power_of_two(k);
}

INLINED double portable_decay(double x) { return 1.0 + portable_expm1(-x); }

INLINED double portable_tanh(double x) {
    double size = fabs(x), value;
    if (size > 22.0) {
        value = 1.0;
    } else if (size >= 1.0) {
        value = 1.0 - 2.0 / (portable_expm1(2.0 * size) + 2.0);
    } else {
        double t = portable_expm1(-2.0 * size);
        value = -t / (t + 2.0);
    }
    return x < 0 ? -value : value;
}

double portable_sinh(double x) {
    double t = portable_expm1(fabs(x)), value;
    if (isinf(t)) {
        value = t;
    } else if (t < 1.0) {
        value = 0.5 * (2.0 * t - t * t / (t + 1.0));
    } else {
        value = 0.5 * (t + t / (t + 1.0));
    }
    return x < 0 ? -value : value;
}

/* ln(1 + y) for 0 <= y <= 1. */
static double log1p_of_share(double y) {
    static const double L1 = 6.666666666666735130e-01, L2 = 3.999999999940941908e-01, L3 = 2.857142874366239149e-01,
                        L4 = 2.222219843214978396e-01, L5 = 1.818357216161805012e-01, L6 = 1.531383769920937332e-01,
                        L7 = 1.479819860511658591e-01;
    int k = y > 0.41421356237309503;
    double f = k ? 0.5 * (y - 1.0) : y; /* 1 + y = 2^k (1 + f), exactly */
    double half_square = 0.5 * f * f, s = f / (2.0 + f), z = s * s;
    double r = z * (L1 + z * (L2 + z * (L3 + z * (L4 + z * (L5 + z * (L6 + z * L7))))));
    if (k == 0) return f - (half_square - s * (half_square + r));
    return LN2_HIGH - ((half_square - (s * (half_square + r) + LN2_LOW)) - f);
}

double portable_softplus(double x) {
    double tail = log1p_of_share(portable_decay(fabs(x)));
    return x > 0 ? x + tail : tail;
}

double portable_arctan(double x) {
    static const double HIGH[] = {4.63647609000806093515e-01, 7.85398163397448278999e-01, 9.82793723247329054082e-01,
                                  1.57079632679489655800e+00},
                        LOW[] = {2.26987774529616870924e-17, 3.06161699786838301793e-17, 1.39033110312309984516e-17,
                                 6.12323399573676603587e-17},
                        A[] = {3.33333333333329318027e-01, -1.99999999998764832476e-01, 1.42857142725034663711e-01,
                               -1.11111104054623557880e-01, 9.09088713343650656196e-02, -7.69187620504482999495e-02,
                               6.66107313738753120669e-02, -5.83357013379057348645e-02, 4.97687799461593236017e-02,
                               -3.65315727442169155270e-02, 1.62858201153657823623e-02};
    double size = fabs(x);
    int part = -1;
    if (isnan(x)) return x;
    if (size >= 0x1p66) return x < 0 ? -HIGH[3] : HIGH[3];
    if (size >= 2.4375) {
        part = 3;
        size = -1.0 / size;
    } else if (size >= 1.1875) {
        part = 2;
        size = (size - 1.5) / (1.0 + 1.5 * size);
    } else if (size >= 0.6875) {
        part = 1;
        size = (size - 1.0) / (size + 1.0);
    } else if (size >= 0.4375) {
        part = 0;
        size = (2.0 * size - 1.0) / (2.0 + size);
    }
    double z = size * size, w = z * z;
    double odd = z * (A[0] + w * (A[2] + w * (A[4] + w * (A[6] + w * (A[8] + w * A[10])))));
    double even = w * (A[1] + w * (A[3] + w * (A[5] + w * (A[7] + w * A[9]))));
    double value = part < 0 ? size - size * (odd + even) : HIGH[part] - ((size * (odd + even) - LOW[part]) - size);
    return x < 0 ? -value : value;
}

double portable_log(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    int k = (int)(bits >> 52) - 0x3ff; /* x = 2^k (1 + y) */
    bits = (bits & 0x000fffffffffffffu) | 0x3ff0000000000000u;
    double significand;
    memcpy(&significand, &bits, sizeof significand);
    return k * LN2_HIGH + (k * LN2_LOW + log1p_of_share(significand - 1.0));
}

/* e^(exponent ln base): a few units in the last place, more the further ln base is from 0. */
double portable_power(double base, double exponent) {
    if (base < 1e-300) return 0.0;
    if (!(base < INFINITY)) return base;
    double power = exponent * portable_log(base);
    return power < 0 ? 1.0 / (1.0 + portable_expm1(-power)) : 1.0 + portable_expm1(power);
}

static double sine_kernel(double x) {
    static const double S1 = -1.66666666666666324348e-01, S2 = 8.33333333332248946124e-03,
                        S3 = -1.98412698298579493134e-04, S4 = 2.75573137070700676789e-06,
                        S5 = -2.50507602534068634195e-08, S6 = 1.58969099521155010221e-10;
    double z = x * x, w = z * z;
    double r = S2 + z * (S3 + z * S4) + z * w * (S5 + z * S6);
    return x + z * x * (S1 + z * r);
}

static double cosine_kernel(double x) {
    static const double C1 = 4.16666666666666019037e-02, C2 = -1.38888888888741095749e-03,
                        C3 = 2.48015872894767294178e-05, C4 = -2.75573143513906633035e-07,
                        C5 = 2.08757232129817482790e-09, C6 = -1.13596475577881948265e-11;
    double z = x * x, w = z * z;
    double r = z * (C1 + z * (C2 + z * C3)) + w * w * (C4 + z * (C5 + z * C6));
    double half = 0.5 * z, rest = 1.0 - half;
    return rest + (((1.0 - rest) - half) + z * r);
}

/* sin(2 pi (turns + quarters/4)): reduced in turns, where the reduction is exact. */
static double sine_from(double turns, int quarters) {
    static const double TWO_PI = 6.28318530717958647692;
    double rest = turns - floor(turns);
    double nearest = floor(4.0 * rest + 0.5);
    double angle = (rest - 0.25 * nearest) * TWO_PI;
    switch (((int)nearest + quarters) & 3) {
        case 0: return sine_kernel(angle);
        case 1: return cosine_kernel(angle);
        case 2: return -sine_kernel(angle);
        default: return -cosine_kernel(angle);
    }
}

double portable_sine(double turns) { return sine_from(turns, 0); }

double portable_cosine(double turns) { return sine_from(turns, 1); }
