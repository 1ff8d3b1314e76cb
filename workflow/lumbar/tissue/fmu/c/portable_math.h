/* Elementary functions that give the same bits on every platform: C libraries differ in the last one. */
#ifndef LUMBAR_PORTABLE_MATH_H
#define LUMBAR_PORTABLE_MATH_H

#if defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF /* as in model.h */
#endif

/* The commonest are drawn into every form that calls them: a sixth of a step with five effects. */
#if defined(__GNUC__)
#define INLINED static inline __attribute__((always_inline))
#else
#define INLINED static inline
#endif

INLINED double portable_expm1(double x); /* e^x - 1 */
INLINED double portable_decay(double x); /* e^-x */
INLINED double portable_tanh(double x);
double portable_sinh(double x);
double portable_arctan(double x);
double portable_log(double x);       /* ln x of a normal x > 0; to the last places of ln 2 just below 1 */
double portable_power(double base, double exponent); /* of a base >= 0 */
double portable_softplus(double x);  /* ln(1 + e^x) */
double portable_sine(double turns);  /* sin(2 pi turns) */
double portable_cosine(double turns);

#endif
