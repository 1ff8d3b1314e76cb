/* A client of FMUs for tests and benchmarks: loads the library of an unzipped FMU, plays what the mode says.
 *
 *   fmu_client hash LIBRARY TOKEN STEPS        hash of all forces over a walk with whole-number arithmetic
 *   fmu_client mistimed LIBRARY TOKEN STEPS H  steps of H seconds summed up, over a static gain sampled at 10 ms
 *   fmu_client timing LIBRARY TOKEN STEPS live|decayed H   nanoseconds per set, step of H s and get, the same steps replayed:
 *                                              median and 99.9 % of the fastest replay, median of the slowest; median and
 *                                              99.9 % of each step's least time; 99.9 % of reading the clock alone
 *   fmu_client passive LIBRARY TOKEN STEPS H UNIT DAMPING [GAIN]   least energy in J that a device with this damping and the
 *                                              FMU have taken in at any sample; the work done. UNIT: of positions in m.
 *                                              With GAIN, the largest, the hand switches the tissue as well
 *   fmu_client threads LIBRARY TOKEN STEPS     eight instances in threads: number of hashes that differ
 *
 * FMI 2.0; `hash` also plays FMI 3.0 in event mode and prints both hashes. How many axes an FMU has, it is asked; `hash`,
 * `mistimed` and `threads` are for one.
 */
#define _POSIX_C_SOURCE 200809L
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#ifdef _WIN32
#include <windows.h>
static void *open_library(const char *path) { return (void *)LoadLibraryA(path); }
static void *find_function(void *library, const char *name) {
    return (void *)(size_t)GetProcAddress((HMODULE)library, name);
}
#else
#include <dlfcn.h>
#include <pthread.h>
static void *open_library(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *find_function(void *library, const char *name) { return dlsym(library, name); }
#endif

#define REQUIRE(condition)                                          \
    do {                                                            \
        if (!(condition)) {                                         \
            fprintf(stderr, "failed: %s\n", #condition);            \
            exit(2);                                                \
        }                                                           \
    } while (0)
#define LOAD(type, name) type *name = NULL; { void *found = find_function(library, #name); \
    REQUIRE(found); memcpy(&name, &found, sizeof found); }

static void *library;
static const char *token;

static void silent2(fmi2ComponentEnvironment e, fmi2String i, fmi2Status s, fmi2String c, fmi2String m, ...) {
    (void)e, (void)i, (void)s, (void)c, (void)m;
}

static void silent3(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String m) {
    (void)e, (void)s, (void)c, (void)m;
}

/* A walk within 4 mm, the same on every platform: 32-bit congruential numbers, scaled by a power of two. */
typedef struct { uint32_t seed; double position; } walk;

static double next_position(walk *w) {
    w->seed = w->seed * 1664525u + 1013904223u;
    double moved = w->position + ((double)(w->seed >> 16) - 32767.5) * 0x1p-19;
    w->position = moved > 4.0 ? 4.0 : moved < -4.0 ? -4.0 : moved;
    return w->position;
}

static uint64_t hashed(uint64_t hash, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return (hash ^ bits) * 1099511628211u;
}

/* Axes of the FMU, and the value references of position and force along each. */
enum { MOST_AXES = 3 };
static int axes = 1;
static const uint32_t INPUT[MOST_AXES] = {1, 17, 33}, OUTPUT[MOST_AXES] = {2, 18, 34};

static fmi2Component start2(void) {
    static const fmi2CallbackFunctions CALLBACKS = {.logger = silent2};
    LOAD(fmi2InstantiateTYPE, fmi2Instantiate)
    LOAD(fmi2SetupExperimentTYPE, fmi2SetupExperiment)
    LOAD(fmi2EnterInitializationModeTYPE, fmi2EnterInitializationMode)
    LOAD(fmi2ExitInitializationModeTYPE, fmi2ExitInitializationMode)
    fmi2Component c = fmi2Instantiate("client", fmi2CoSimulation, token, "", &CALLBACKS, 0, 0);
    REQUIRE(c && !fmi2SetupExperiment(c, 0, 0, 0.0, 0, 0) && !fmi2EnterInitializationMode(c));
    REQUIRE(!fmi2ExitInitializationMode(c));
    LOAD(fmi2GetRealTYPE, fmi2GetReal)
    double unused;
    for (axes = 1; axes < MOST_AXES && !fmi2GetReal(c, &OUTPUT[axes], 1, &unused);) ++axes;
    return c;
}

static uint64_t play2(long steps, double h) {
    LOAD(fmi2SetRealTYPE, fmi2SetReal)
    LOAD(fmi2GetRealTYPE, fmi2GetReal)
    LOAD(fmi2DoStepTYPE, fmi2DoStep)
    LOAD(fmi2FreeInstanceTYPE, fmi2FreeInstance)
    fmi2Component c = start2();
    const fmi2ValueReference input = 1, output = 2;
    walk w = {.seed = 1};
    uint64_t hash = 14695981039346656037u;
    for (long k = 0; k < steps; ++k) {
        double position = next_position(&w), force;
        REQUIRE(!fmi2SetReal(c, &input, 1, &position) && !fmi2DoStep(c, (double)k * h, h, 1));
        REQUIRE(!fmi2GetReal(c, &output, 1, &force));
        hash = hashed(hash, force);
    }
    fmi2FreeInstance(c);
    return hash;
}

static uint64_t play3(long steps, double h) {
    LOAD(fmi3InstantiateCoSimulationTYPE, fmi3InstantiateCoSimulation)
    LOAD(fmi3EnterInitializationModeTYPE, fmi3EnterInitializationMode)
    LOAD(fmi3ExitInitializationModeTYPE, fmi3ExitInitializationMode)
    LOAD(fmi3EnterEventModeTYPE, fmi3EnterEventMode)
    LOAD(fmi3EnterStepModeTYPE, fmi3EnterStepMode)
    LOAD(fmi3SetFloat64TYPE, fmi3SetFloat64)
    LOAD(fmi3GetFloat64TYPE, fmi3GetFloat64)
    LOAD(fmi3DoStepTYPE, fmi3DoStep)
    LOAD(fmi3FreeInstanceTYPE, fmi3FreeInstance)
    fmi3Instance c = fmi3InstantiateCoSimulation("client", token, NULL, 0, 0, 1, 0, NULL, 0, NULL, silent3, NULL);
    REQUIRE(c && !fmi3EnterInitializationMode(c, 0, 0, 0.0, 0, 0) && !fmi3ExitInitializationMode(c));
    const fmi3ValueReference input = 1, output = 2;
    walk w = {.seed = 1};
    uint64_t hash = 14695981039346656037u;
    for (long k = 0; k < steps; ++k) {
        double position = next_position(&w), force, reached;
        fmi3Boolean event, ends, early;
        REQUIRE(!fmi3SetFloat64(c, &input, 1, &position, 1) && !fmi3GetFloat64(c, &output, 1, &force, 1));
        REQUIRE(!fmi3EnterStepMode(c) && !fmi3DoStep(c, (double)k * h, h, 1, &event, &ends, &early, &reached));
        REQUIRE(event && !fmi3EnterEventMode(c));
        hash = hashed(hash, force);
    }
    fmi3FreeInstance(c);
    return hash;
}

/* A hand that means harm: half of its steps are random, of all sizes, the others take out all that the force then held can
 * give, more or less. Returned is the least energy at any sample: what went into device and FMU, the damping's share included
 * by its least, b d^2 / h. */
typedef struct {
    uint32_t seed;
    double energy, least, most, damping, unit, position[MOST_AXES], h, largest_gain;
} hand;

static double share(hand *a) {
    a->seed = a->seed * 1664525u + 1013904223u;
    return (double)(a->seed >> 8) * 0x1p-24;
}

static double dot(const double a[], const double b[]) {
    double sum = 0.0;
    for (int i = 0; i < axes; ++i) sum += a[i] * b[i];
    return sum;
}

static void moved_by(hand *a, const double force[]) {
    double size = 1.0, step[MOST_AXES], metres[MOST_AXES];
    for (int i = (int)(share(a) * 12.0); i > 0; --i) size *= 0.5;
    for (int i = 0; i < axes; ++i) step[i] = (2.0 * share(a) - 1.0) * size;
    if (share(a) < 0.5) {
        const double part = -2.0 * share(a);
        for (int i = 0; i < axes; ++i) step[i] = part * force[i] * a->h / (2.0 * a->damping) / a->unit;
    }
    for (int i = 0; i < axes; ++i) {
        double next = a->position[i] + step[i];
        if (next > 20.0 || next < -20.0) step[i] = -0.5 * a->position[i];
        a->position[i] += step[i];
        metres[i] = step[i] * a->unit;
    }
    const double work = dot(force, metres);
    a->energy += work + a->damping * dot(metres, metres) / a->h;
    if (a->energy < a->least) a->least = a->energy;
    a->most += work > 0 ? work : 0;
}

/* What the hand does to the parameters before a step: gain, and where and how much the tissue presses at rest. The gain: none on
 * the way in and all on the way out, off and on, a little more or less, or the one of which `force` is the largest now. */
enum { GAIN = 3, FORCE_OFFSET, POSITION_OFFSET = 6 };
typedef void setter(void *fmu, uint32_t variable, double value);
typedef double getter(void *fmu); /* the force's square */

static double gain_of(hand *a, double gain, void *fmu, setter *set, getter *force) {
    static const double SHARES[] = {0.0, 0.01, 0.3, 1.0};
    double kind = share(a), best = a->largest_gain, most = -1.0;
    if (kind < 0.5) return gain;
    if (kind < 0.6) return share(a) < 0.5 ? 0.0 : 1.0;
    if (kind < 0.7) return a->largest_gain * share(a);
    if (kind < 0.8) return a->position[0] < 10.0 * share(a) ? 0.0 : a->largest_gain;
    if (kind < 0.9) return gain * 0.9 + a->largest_gain * 0.1 * share(a);
    for (int i = 0; force && i < 4; ++i) {
        set(fmu, GAIN, SHARES[i] * a->largest_gain);
        double found = force(fmu);
        if (found > most) most = found, best = SHARES[i] * a->largest_gain;
    }
    return best;
}

/* Of what was taken in before a rise of the gain, less what the force `still` to be displayed may give, the hand gets the share that
 * the old gain has of the new one: more would throw it. */
static void switched(hand *a, double *gain, double still_squared, void *fmu, setter *set, getter *force) {
    if (!(a->largest_gain > 0.0)) return;
    if (share(a) < 0.01) set(fmu, FORCE_OFFSET, 2.0 * share(a) - 1.0);
    if (share(a) < 0.01) set(fmu, POSITION_OFFSET, 10.0 * share(a) - 5.0);
    double next = gain_of(a, *gain, fmu, set, force), owed = still_squared * a->h / (4.0 * a->damping);
    set(fmu, GAIN, next);
    if (next > *gain) a->energy = owed + *gain / next * (a->energy - owed);
    *gain = next;
}

static void set2(void *fmu, uint32_t variable, double value) {
    LOAD(fmi2SetRealTYPE, fmi2SetReal)
    REQUIRE(!fmi2SetReal(fmu, &variable, 1, &value));
}

static void set3(void *fmu, uint32_t variable, double value) {
    LOAD(fmi3SetFloat64TYPE, fmi3SetFloat64)
    const double values[MOST_AXES] = {value, -value, 0.5 * value};
    REQUIRE(!fmi3SetFloat64(fmu, &variable, 1, values, variable == GAIN ? 1 : (size_t)axes));
}

static void forces3(void *fmu, double force[]) {
    LOAD(fmi3GetFloat64TYPE, fmi3GetFloat64)
    REQUIRE(!fmi3GetFloat64(fmu, OUTPUT, 1, force, (size_t)axes));
}

static double force3(void *fmu) {
    double force[MOST_AXES];
    forces3(fmu, force);
    return dot(force, force);
}

/* A force is displayed at once, as where a device's clock waits for the step, or `late`, from the step's end on. */
static void passive2(hand *a, long steps, int late) {
    LOAD(fmi2SetRealTYPE, fmi2SetReal)
    LOAD(fmi2GetRealTYPE, fmi2GetReal)
    LOAD(fmi2DoStepTYPE, fmi2DoStep)
    LOAD(fmi2FreeInstanceTYPE, fmi2FreeInstance)
    fmi2Component c = start2();
    const size_t count = (size_t)axes;
    double force[MOST_AXES], before[MOST_AXES], gain = 1.0;
    REQUIRE(!fmi2GetReal(c, OUTPUT, count, force));
    memcpy(before, force, sizeof force);
    for (long k = 0; k < steps; ++k) {
        if (k) moved_by(a, late ? before : force);
        memcpy(before, force, sizeof force);
        switched(a, &gain, late ? dot(force, force) : 0.0, c, set2, NULL);
        REQUIRE(!fmi2SetReal(c, INPUT, count, a->position) && !fmi2DoStep(c, (double)k * a->h, a->h, 1));
        REQUIRE(!fmi2GetReal(c, OUTPUT, count, force));
    }
    fmi2FreeInstance(c);
}

static void passive3(hand *a, long steps) {
    LOAD(fmi3InstantiateCoSimulationTYPE, fmi3InstantiateCoSimulation)
    LOAD(fmi3EnterInitializationModeTYPE, fmi3EnterInitializationMode)
    LOAD(fmi3ExitInitializationModeTYPE, fmi3ExitInitializationMode)
    LOAD(fmi3EnterEventModeTYPE, fmi3EnterEventMode)
    LOAD(fmi3EnterStepModeTYPE, fmi3EnterStepMode)
    LOAD(fmi3SetFloat64TYPE, fmi3SetFloat64)
    LOAD(fmi3DoStepTYPE, fmi3DoStep)
    LOAD(fmi3FreeInstanceTYPE, fmi3FreeInstance)
    fmi3Instance c = fmi3InstantiateCoSimulation("client", token, NULL, 0, 0, 1, 0, NULL, 0, NULL, silent3, NULL);
    REQUIRE(c && !fmi3EnterInitializationMode(c, 0, 0, 0.0, 0, 0) && !fmi3ExitInitializationMode(c));
    double force[MOST_AXES] = {0.0}, reached, gain = 1.0;
    for (long k = 0; k < steps; ++k) {
        fmi3Boolean event, ends, early;
        if (k) moved_by(a, force);
        REQUIRE(!fmi3SetFloat64(c, INPUT, 1, a->position, (size_t)axes));
        switched(a, &gain, 0.0, c, set3, force3);
        forces3(c, force);
        REQUIRE(!fmi3EnterStepMode(c) && !fmi3DoStep(c, (double)k * a->h, a->h, 1, &event, &ends, &early, &reached));
        REQUIRE(event && !fmi3EnterEventMode(c));
    }
    fmi3FreeInstance(c);
}

static void passive(long steps, double h, double unit, double damping, double largest_gain) {
    hand at_once = {.seed = 1, .h = h, .unit = unit, .damping = damping, .largest_gain = largest_gain};
    hand late = at_once, event = at_once;
    passive2(&at_once, steps, 0);
    passive2(&late, steps, 1);
    passive3(&event, steps);
    printf("%g %g %g %g %g %g\n", at_once.least, late.least, event.least, at_once.most, late.most, event.most);
}

static void mistimed(long steps, double h) {
    LOAD(fmi2SetRealTYPE, fmi2SetReal)
    LOAD(fmi2GetRealTYPE, fmi2GetReal)
    LOAD(fmi2DoStepTYPE, fmi2DoStep)
    LOAD(fmi2FreeInstanceTYPE, fmi2FreeInstance)
    fmi2Component c = start2();
    const fmi2ValueReference input = 1, output = 2;
    const long ticks = (long)(0.01 / h + 0.5); /* per sample */
    double time = 0.0;
    long wrong = 0;
    for (long k = 0; k < steps; ++k) {
        double position = (double)k, force;
        REQUIRE(!fmi2SetReal(c, &input, 1, &position) && !fmi2DoStep(c, time, h, 1));
        REQUIRE(!fmi2GetReal(c, &output, 1, &force));
        time += h;
        wrong += force != (double)(k - k % ticks);
    }
    fmi2FreeInstance(c);
    printf("%ld\n", wrong);
}

#ifndef _WIN32
static long nanoseconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000000000L + now.tv_nsec;
}

static int ascending(const void *a, const void *b) {
    const long x = *(const long *)a, y = *(const long *)b;
    return (x > y) - (x < y);
}

enum { REPLAYS = 7 };

/* Times of set, step and get, less that of reading the clock. */
static void timed_steps(long taken[], long steps, double h, int decayed, long clock_cost) {
    LOAD(fmi2SetRealTYPE, fmi2SetReal)
    LOAD(fmi2GetRealTYPE, fmi2GetReal)
    LOAD(fmi2DoStepTYPE, fmi2DoStep)
    LOAD(fmi2FreeInstanceTYPE, fmi2FreeInstance)
    fmi2Component c = start2();
    walk w[MOST_AXES] = {{.seed = 1}, {.seed = 2}, {.seed = 3}};
    long k = 0;
    const size_t count = (size_t)axes;
    double position[MOST_AXES], force[MOST_AXES];
    for (; k < 20000; ++k) { /* warm; a decayed model is left alone after a push of 100 samples */
        for (int i = 0; i < axes; ++i) position[i] = decayed ? (k < 100 ? 1.0 : 0.0) : next_position(&w[i]);
        REQUIRE(!fmi2SetReal(c, INPUT, count, position) && !fmi2DoStep(c, (double)k * h, h, 1));
    }
    for (long i = 0; i < steps; ++i, ++k) {
        for (int j = 0; j < axes; ++j) position[j] = decayed ? 0.0 : next_position(&w[j]);
        long begin = nanoseconds();
        int status = fmi2SetReal(c, INPUT, count, position) | fmi2DoStep(c, (double)k * h, h, 1);
        status |= fmi2GetReal(c, OUTPUT, count, force);
        taken[i] = nanoseconds() - begin - clock_cost;
        REQUIRE(!status);
    }
    fmi2FreeInstance(c);
}

/* What interrupts a step does not do so in every replay: the least time of each step is the FMU's own. */
static void timing(long steps, double h, int decayed) {
    long *taken = malloc((size_t)steps * sizeof *taken), *least = malloc((size_t)steps * sizeof *least);
    REQUIRE(taken && least);
    for (long k = 0; k < steps; ++k) {
        long begin = nanoseconds();
        taken[k] = nanoseconds() - begin;
    }
    qsort(taken, (size_t)steps, sizeof *taken, ascending);
    const long clock_cost = taken[steps / 2], high = (long)((double)steps * 0.999), clock_high = taken[high];
    long fastest[2] = {0}, slowest = 0;
    for (int replay = 0; replay < REPLAYS; ++replay) {
        timed_steps(taken, steps, h, decayed, clock_cost);
        for (long k = 0; k < steps; ++k) least[k] = replay && least[k] < taken[k] ? least[k] : taken[k];
        qsort(taken, (size_t)steps, sizeof *taken, ascending);
        const long median = taken[steps / 2];
        if (!replay || median < fastest[0]) fastest[0] = median, fastest[1] = taken[high];
        if (median > slowest) slowest = median;
    }
    qsort(least, (size_t)steps, sizeof *least, ascending);
    printf("%ld %ld %ld %ld %ld %ld\n", fastest[0], fastest[1], slowest, least[steps / 2], least[high], clock_high);
}

typedef struct { long steps; uint64_t hash; } job;

static void *work(void *argument) {
    job *j = argument;
    j->hash = play2(j->steps, 0.01);
    return NULL;
}

static void threads(long steps) {
    enum { THREADS = 8 };
    pthread_t thread[THREADS];
    job jobs[THREADS];
    int differing = 0;
    for (int i = 0; i < THREADS; ++i) {
        jobs[i] = (job){.steps = steps};
        REQUIRE(!pthread_create(&thread[i], NULL, work, &jobs[i]));
    }
    for (int i = 0; i < THREADS; ++i) REQUIRE(!pthread_join(thread[i], NULL));
    for (int i = 0; i < THREADS; ++i) differing += jobs[i].hash != play2(steps, 0.01);
    printf("%d\n", differing);
}
#endif

int main(int count, char *arguments[]) {
    REQUIRE(count >= 5);
    library = open_library(arguments[2]);
    token = arguments[3];
    long steps = strtol(arguments[4], NULL, 10);
    REQUIRE(library && steps > 0);
    if (!strcmp(arguments[1], "hash")) {
        printf("%016llx %016llx\n", (unsigned long long)play2(steps, 0.01), (unsigned long long)play3(steps, 0.01));
    } else if (!strcmp(arguments[1], "passive")) {
        REQUIRE(count == 8 || count == 9);
        double numbers[4] = {0.0};
        for (int i = 5; i < count; ++i) numbers[i - 5] = strtod(arguments[i], NULL);
        passive(steps, numbers[0], numbers[1], numbers[2], numbers[3]);
    } else if (!strcmp(arguments[1], "mistimed")) {
        REQUIRE(count == 6);
        mistimed(steps, strtod(arguments[5], NULL));
#ifndef _WIN32
    } else if (!strcmp(arguments[1], "timing")) {
        REQUIRE(count == 7);
        timing(steps, strtod(arguments[6], NULL), !strcmp(arguments[5], "decayed"));
    } else if (!strcmp(arguments[1], "threads")) {
        threads(steps);
#endif
    } else {
        return 2;
    }
    return 0;
}
