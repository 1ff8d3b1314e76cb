/* What importers do and should not do, and what a model's sources answer. Linked with them, for sanitizers to watch.
 *
 *   fmu_misuse                 every misuse once: prints those that were not answered as the documentation says
 *   fmu_misuse random SEED N   N calls in any order with any values
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "fmi3Functions.h"
#include "model.h"

static int wrong;

#define EXPECT(call, status)                                                      \
    do {                                                                          \
        int answered = (int)(call);                                                  \
        if (answered != (int)(status)) {                                             \
            printf("line %d: %s gave %d\n", __LINE__, #call, answered);              \
            ++wrong;                                                              \
        }                                                                         \
    } while (0)
#define HOLDS(condition) EXPECT(!!(condition), 1)

enum { INPUT = 1, OUTPUT, GAIN, OUTPUT_OFFSET, OUTPUT_LIMIT, INPUT_OFFSET };
enum { BYTES = 1 << 14 };

static const fmi2ValueReference ALL[] = {INPUT, OUTPUT, GAIN, OUTPUT_OFFSET, OUTPUT_LIMIT, INPUT_OFFSET};
static const fmi2ValueReference IN = INPUT, OUT = OUTPUT, FACTOR = GAIN, TIME = 0;
static const fmi2CallbackFunctions NO_LOGGER = {0};
static int messages;

static void logger2(fmi2ComponentEnvironment e, fmi2String name, fmi2Status s, fmi2String category, fmi2String text, ...) {
    (void)e, (void)s;
    HOLDS(name && *name && category && text);
    ++messages;
}

static void logger3(fmi3InstanceEnvironment e, fmi3Status s, fmi3String category, fmi3String text) {
    (void)e, (void)s;
    HOLDS(category && text);
    ++messages;
}

static fmi2Component new2(void) { return fmi2Instantiate("x", fmi2CoSimulation, MODEL.token, "", &NO_LOGGER, 0, 0); }

static fmi3Instance new3(bool event_mode, bool early_return) {
    return fmi3InstantiateCoSimulation("x", MODEL.token, NULL, 0, 0, event_mode, early_return, NULL, 0, NULL, NULL, NULL);
}

static double force2(fmi2Component c) {
    double value = NAN;
    EXPECT(fmi2GetReal(c, &OUT, 1, &value), fmi2OK);
    HOLDS(isfinite(value));
    return value;
}

static void play2(fmi2Component c, double start, int from, int to, double forces[]) {
    for (int k = from; k < to; ++k) {
        double position = 0.05 * (k % 9) - 0.02 * (k % 4);
        EXPECT(fmi2SetReal(c, &IN, 1, &position), fmi2OK);
        EXPECT(fmi2DoStep(c, start + k * MODEL.sampling_time, MODEL.sampling_time, 1), fmi2OK);
        forces[k] = force2(c);
    }
}

static void instantiate2(void) {
    static const fmi2CallbackFunctions LOGGING = {.logger = logger2};
    static const char *const RESOURCES[] = {NULL, "", "file:///a%20b/resources", "file:///a/resources/", "\xc3\xa4"};
    static const char *const NAMES[] = {"x", " ", "\xc3\xa4 \xe2\x82\xac", "%s%n", "<a & b>"};
    HOLDS(!fmi2Instantiate("x", fmi2CoSimulation, MODEL.token, "", NULL, 0, 0));
    HOLDS(!fmi2Instantiate(NULL, fmi2CoSimulation, MODEL.token, "", &LOGGING, 0, 1));
    HOLDS(!fmi2Instantiate("", fmi2CoSimulation, MODEL.token, "", &NO_LOGGER, 0, 1));
    HOLDS(!fmi2Instantiate("x", fmi2ModelExchange, MODEL.token, "", &LOGGING, 0, 1));
    HOLDS(!fmi2Instantiate("x", fmi2CoSimulation, "other", "", &LOGGING, 0, 1));
    HOLDS(!fmi2Instantiate("x", fmi2CoSimulation, NULL, "", &LOGGING, 0, 1));
    HOLDS(messages == 4);
    for (int i = 0; i < 5; ++i) {
        fmi2Component c = fmi2Instantiate(NAMES[i], fmi2CoSimulation, MODEL.token, RESOURCES[i], &LOGGING, i & 1, 1);
        double nothing = NAN;
        HOLDS(c);
        EXPECT(fmi2SetDebugLogging(c, 1, 0, NULL), fmi2OK);
        EXPECT(fmi2SetReal(c, &IN, 1, &nothing), fmi2Warning);
        fmi2FreeInstance(c);
    }
    fmi2FreeInstance(NULL);
}

static void order2(void) {
    fmi2Component c = new2();
    double value = 1.0, all[6];
    EXPECT(fmi2DoStep(c, 0.0, MODEL.sampling_time, 1), fmi2Error);
    EXPECT(fmi2ExitInitializationMode(c), fmi2Error);
    EXPECT(fmi2GetReal(c, ALL, 6, all), fmi2OK); /* before anything */
    EXPECT(fmi2SetupExperiment(c, 1, 1e-6, NAN, 0, 0.0), fmi2Error);
    EXPECT(fmi2SetupExperiment(c, 1, 1e-6, INFINITY, 0, 0.0), fmi2Error);
    EXPECT(fmi2SetupExperiment(c, 1, 1e-6, 2.0, 0, NAN), fmi2OK); /* stop not defined, tolerance defined */
    EXPECT(fmi2EnterInitializationMode(c), fmi2OK);
    EXPECT(fmi2EnterInitializationMode(c), fmi2Error);
    EXPECT(fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0), fmi2Error);
    EXPECT(fmi2ExitInitializationMode(c), fmi2OK);
    EXPECT(fmi2ExitInitializationMode(c), fmi2Error);
    EXPECT(fmi2GetReal(c, &OUT, 1, &value), fmi2OK); /* before the first step */
    EXPECT(fmi2DoStep(c, 0.0, MODEL.sampling_time, 1), fmi2Error); /* it started at 2 */
    EXPECT(fmi2DoStep(c, 2.0, 0.0, 1), fmi2Error);
    EXPECT(fmi2DoStep(c, 2.0, -MODEL.sampling_time, 1), fmi2Error);
    EXPECT(fmi2DoStep(c, 2.0, NAN, 1), fmi2Error);
    EXPECT(fmi2DoStep(c, NAN, MODEL.sampling_time, 1), fmi2Error);
    EXPECT(fmi2DoStep(c, 2.0, INFINITY, 1), fmi2Error);
    EXPECT(fmi2DoStep(c, 2.0, 1e300, 1), fmi2Error);
    EXPECT(fmi2DoStep(c, 2.0, 1e-300, 1), fmi2OK);
    EXPECT(fmi2DoStep(c, 2.0, 1000 * MODEL.sampling_time, 0), fmi2OK);
    EXPECT(fmi2DoStep(c, 2.0, MODEL.sampling_time, 1), fmi2Error); /* not where the last one ended */
    EXPECT(fmi2CancelStep(c), fmi2Error);
    EXPECT(fmi2SetReal(c, &OUT, 1, &value), fmi2Error);
    EXPECT(fmi2SetReal(c, &TIME, 1, &value), fmi2Error);
    EXPECT(fmi2GetReal(c, &TIME, 1, &value), fmi2Error);
    EXPECT(fmi2GetReal(c, NULL, 0, NULL), fmi2OK);
    EXPECT(fmi2SetReal(c, NULL, 0, NULL), fmi2OK);
    EXPECT(fmi2GetInteger(c, NULL, 0, NULL), fmi2OK);
    EXPECT(fmi2GetString(c, &IN, 1, NULL), fmi2Error);
    EXPECT(fmi2Terminate(c), fmi2OK);
    EXPECT(fmi2GetReal(c, &OUT, 1, &value), fmi2OK);
    EXPECT(fmi2SetReal(c, &IN, 1, &value), fmi2Error);
    EXPECT(fmi2DoStep(c, 2.0, MODEL.sampling_time, 1), fmi2Error);
    EXPECT(fmi2Reset(c), fmi2OK); /* after terminate: a new instance */
    EXPECT(fmi2EnterInitializationMode(c), fmi2OK); /* without fmi2SetupExperiment: from 0 */
    EXPECT(fmi2ExitInitializationMode(c), fmi2OK);
    EXPECT(fmi2DoStep(c, 0.0, MODEL.sampling_time, 1), fmi2OK);
    fmi2FreeInstance(c);
    EXPECT(fmi2DoStep(NULL, 0.0, 1.0, 1), fmi2Error);
    EXPECT(fmi2GetReal(NULL, &OUT, 1, &value), fmi2Error);
    EXPECT(fmi2CancelStep(NULL), fmi2Error);
    EXPECT(fmi2Terminate(NULL), fmi2Error);
}

/* Reset in the middle, two instances side by side, gain between steps: the same bits each time. */
static void repeat2(void) {
    enum { SAMPLES = 60 };
    double first[SAMPLES], again[SAMPLES], beside[SAMPLES], factor = 2.0;
    fmi2Component c = new2(), other = new2();
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0), fmi2EnterInitializationMode(c), fmi2ExitInitializationMode(c);
    play2(c, 0.0, 0, SAMPLES, first);
    EXPECT(fmi2SetReal(c, &FACTOR, 1, &factor), fmi2OK);
    EXPECT(fmi2Reset(c), fmi2OK);
    EXPECT(fmi2SetupExperiment(c, 0, 0.0, 0.0, 1, 1.0), fmi2OK);
    fmi2EnterInitializationMode(c), fmi2ExitInitializationMode(c);
    fmi2SetupExperiment(other, 0, 0.0, 0.0, 0, 0.0), fmi2EnterInitializationMode(other);
    fmi2ExitInitializationMode(other);
    for (int k = 0; k < SAMPLES; ++k) {
        play2(c, 0.0, k, k + 1, again);
        play2(other, 0.0, k, k + 1, beside);
        EXPECT(fmi2SetReal(c, &FACTOR, 1, &factor), fmi2OK);
        HOLDS(fabs(force2(c)) <= MODEL.output_limit);
        factor = 3.0 - factor;
        EXPECT(fmi2SetReal(c, &FACTOR, 1, &factor), fmi2OK);
        factor = 1.0;
        EXPECT(fmi2SetReal(c, &FACTOR, 1, &factor), fmi2OK);
    }
    HOLDS(memcmp(first, again, sizeof first) == 0 && memcmp(first, beside, sizeof first) == 0);
    fmi2FreeInstance(c), fmi2FreeInstance(other);
}

static void states2(void) {
    enum { SAMPLES = 40 };
    double expected[SAMPLES], found[SAMPLES];
    fmi2Component c = new2(), other = new2();
    fmi2FMUstate state = NULL, copy = NULL;
    fmi2Byte bytes[BYTES];
    size_t size = 0;
    fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0), fmi2EnterInitializationMode(c), fmi2ExitInitializationMode(c);
    play2(c, 0.0, 0, SAMPLES / 2, expected);
    EXPECT(fmi2GetFMUstate(c, NULL), fmi2Error);
    EXPECT(fmi2GetFMUstate(c, &state), fmi2OK);
    EXPECT(fmi2GetFMUstate(c, &state), fmi2OK); /* into the same place */
    EXPECT(fmi2SetFMUstate(c, NULL), fmi2Error);
    EXPECT(fmi2SerializedFMUstateSize(c, state, &size), fmi2OK);
    HOLDS(size <= BYTES);
    EXPECT(fmi2SerializeFMUstate(c, NULL, bytes, size), fmi2Error);
    EXPECT(fmi2SerializeFMUstate(c, state, NULL, size), fmi2Error);
    EXPECT(fmi2SerializeFMUstate(c, state, bytes, size - 1), fmi2Error);
    EXPECT(fmi2SerializeFMUstate(c, state, bytes, size), fmi2OK);
    play2(c, 0.0, SAMPLES / 2, SAMPLES, expected);
    EXPECT(fmi2DeSerializeFMUstate(other, bytes, size - 1, &copy), fmi2Error);
    EXPECT(fmi2DeSerializeFMUstate(other, NULL, size, &copy), fmi2Error);
    EXPECT(fmi2DeSerializeFMUstate(other, bytes, size, NULL), fmi2Error);
    for (size_t i = 0; i < size; i += 7) {
        bytes[i] ^= 4;
        EXPECT(fmi2DeSerializeFMUstate(other, bytes, size, &copy), fmi2Error);
        bytes[i] ^= 4;
    }
    HOLDS(!copy);
    EXPECT(fmi2DeSerializeFMUstate(other, bytes, size, &copy), fmi2OK);
    EXPECT(fmi2SetFMUstate(other, copy), fmi2OK); /* into an instance that was never initialized */
    play2(other, 0.0, SAMPLES / 2, SAMPLES, found);
    HOLDS(memcmp(expected + SAMPLES / 2, found + SAMPLES / 2, sizeof expected / 2) == 0);
    for (int i = 0; i < 2; ++i) EXPECT(fmi2FreeFMUstate(c, &state), fmi2OK); /* at the second time NULL */
    EXPECT(fmi2FreeFMUstate(c, NULL), fmi2OK);
    fmi2FreeFMUstate(other, &copy);
    fmi2FreeInstance(c), fmi2FreeInstance(other);
}

static void instantiate3(void) {
    const fmi3ValueReference output = OUTPUT;
    HOLDS(!fmi3InstantiateCoSimulation(NULL, MODEL.token, "", 0, 1, 0, 0, NULL, 0, NULL, logger3, NULL));
    HOLDS(!fmi3InstantiateCoSimulation("", MODEL.token, "", 0, 1, 0, 0, NULL, 0, NULL, NULL, NULL));
    HOLDS(!fmi3InstantiateCoSimulation("x", "other", "", 0, 1, 0, 0, NULL, 0, NULL, logger3, NULL));
    HOLDS(!fmi3InstantiateCoSimulation("x", NULL, "", 0, 1, 0, 0, NULL, 0, NULL, NULL, NULL));
    HOLDS(!fmi3InstantiateCoSimulation("x", MODEL.token, "", 0, 1, 1, 1, &output, 1, NULL, logger3, NULL));
    HOLDS(!fmi3InstantiateModelExchange("x", MODEL.token, NULL, 0, 0, NULL, logger3));
    fmi3Instance c = fmi3InstantiateCoSimulation("\xc3\xa4", MODEL.token, "/a b/resources/", 1, 1, 0, 1, NULL, 0, NULL,
                                                 logger3, NULL);
    HOLDS(c);
    fmi3FreeInstance(c), fmi3FreeInstance(NULL);
}

static void order3(bool event_mode, bool early_return) {
    const fmi3ValueReference input = INPUT, output = OUTPUT, time = 0;
    fmi3Boolean event, ends, early, a, b;
    double value = 0.3, reached;
    fmi3Instance c = new3(event_mode, early_return);
    const double T = MODEL.sampling_time;
    EXPECT(fmi3GetFloat64(c, &output, 1, &value, 1), fmi3OK);
    EXPECT(fmi3DoStep(c, 0.0, T, 1, &event, &ends, &early, &reached), fmi3Error);
    EXPECT(fmi3EnterStepMode(c), fmi3Error);
    EXPECT(fmi3EnterEventMode(c), fmi3Error);
    EXPECT(fmi3ExitInitializationMode(c), fmi3Error);
    EXPECT(fmi3EnterInitializationMode(c, 1, 1e-6, NAN, 0, 0.0), fmi3Error);
    EXPECT(fmi3EnterInitializationMode(c, 1, 1e-6, 0.0, 0, NAN), fmi3OK);
    EXPECT(fmi3EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0), fmi3Error);
    EXPECT(fmi3SetFloat64(c, &input, 1, &value, 1), fmi3OK);
    EXPECT(fmi3ExitInitializationMode(c), fmi3OK);
    EXPECT(fmi3UpdateDiscreteStates(c, &a, &b, &event, &ends, &early, &reached), event_mode ? fmi3OK : fmi3Error);
    EXPECT(fmi3UpdateDiscreteStates(c, NULL, &b, &event, &ends, &early, &reached), fmi3Error);
    EXPECT(fmi3EnterStepMode(c), event_mode ? fmi3OK : fmi3Error);
    EXPECT(fmi3DoStep(c, 0.0, T, 1, NULL, &ends, &early, &reached), fmi3Error);
    EXPECT(fmi3DoStep(c, 0.0, -T, 1, &event, &ends, &early, &reached), fmi3Error);
    EXPECT(fmi3DoStep(c, 0.0, 0.0, 1, &event, &ends, &early, &reached), fmi3Error);
    EXPECT(fmi3DoStep(c, 0.0, 1e300, 1, &event, &ends, &early, &reached), fmi3Error);
    EXPECT(fmi3DoStep(c, 1.0, T, 1, &event, &ends, &early, &reached), fmi3Error);
    HOLDS(!event && !ends && !early && reached == 0.0);
    EXPECT(fmi3DoStep(c, 0.0, 5.5 * T, 1, &event, &ends, &early, &reached), fmi3OK);
    HOLDS(early == (event_mode && early_return) && fabs(reached - (early ? T : 5.5 * T)) < 1e-12);
    HOLDS(event == early); /* between samples there is no event */
    /* An importer that does not care for the event goes on: the sample is taken as in FMI 2.0. */
    EXPECT(fmi3DoStep(c, reached, T, 1, &event, &ends, &early, &reached), fmi3OK);
    EXPECT(fmi3GetFloat64(c, &time, 1, &value, 1), fmi3OK);
    HOLDS(value == reached);
    EXPECT(fmi3GetFloat64(c, &output, 1, &value, 2), fmi3Error);
    EXPECT(fmi3GetInt32(c, &input, 1, NULL, 1), fmi3Error);
    EXPECT(fmi3EnterConfigurationMode(c), fmi3Error);
    EXPECT(fmi3EnterContinuousTimeMode(c), fmi3Error);
    EXPECT(fmi3Terminate(c), fmi3OK);
    EXPECT(fmi3DoStep(c, reached, T, 1, &event, &ends, &early, &reached), fmi3Error);
    EXPECT(fmi3Reset(c), fmi3OK);
    EXPECT(fmi3EnterInitializationMode(c, 0, 0.0, -5.0, 1, 1.0), fmi3OK);
    EXPECT(fmi3ExitInitializationMode(c), fmi3OK);
    fmi3FreeInstance(c);
    EXPECT(fmi3DoStep(NULL, 0.0, T, 1, &event, &ends, &early, &reached), fmi3Error);
    EXPECT(fmi3Reset(NULL), fmi3Error);
}

/* Any call with any value, of two instances of each version. What is read must be finite and within the limit. */

static uint32_t seed;

static uint32_t drawn(uint32_t below) {
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % below;
}

static double any_value(void) {
    static const double VALUES[] = {0.0,  -0.0,   1.0,     -1.0,  0.5,   2.0,      1e-300, -1e-310, 1e300, -1e308,
                                    NAN, INFINITY, -INFINITY, 15.0, -20.0, 1.7e308, 1e-9,   0.01,    0.001, 37.0};
    return VALUES[drawn(sizeof VALUES / sizeof *VALUES)];
}

static void sound(double value) { HOLDS(isfinite(value) && fabs(value) <= MODEL.output_limit); }

static void random_calls(long calls) {
    fmi2Component c2[2] = {new2(), new2()};
    fmi3Instance c3[2] = {new3(true, true), new3(false, false)};
    fmi2FMUstate state2 = NULL;
    fmi3FMUState state3[2] = {NULL, NULL};
    static uint8_t bytes[BYTES];
    double time2[2] = {0}, time3[2] = {0};
    long steps = 0;
    for (long k = 0; k < calls; ++k) {
        int i = (int)drawn(2);
        fmi2ValueReference vr = drawn(8);
        double value = any_value(), read = 0.0, one = 1.0;
        double step = drawn(4) ? MODEL.sampling_time * (1 + drawn(30)) / (1 + drawn(9)) : any_value();
        if (step > 1e4 * MODEL.sampling_time && step < 1e8) step = 1e8; /* refused at once; allowed ones may take long */
        fmi3Boolean a, b, c, d, e;
        size_t size;
        switch (drawn(24)) {
            case 0: fmi2Reset(c2[i]), time2[i] = 0.0; break;
            case 1: fmi2SetupExperiment(c2[i], a = drawn(2), value, drawn(3) ? 0.0 : any_value(), 0, 0.0); break;
            case 2: fmi2EnterInitializationMode(c2[i]), fmi2GetRealStatus(c2[i], fmi2LastSuccessfulTime, &time2[i]); break;
            case 3: fmi2ExitInitializationMode(c2[i]); break;
            case 4: fmi2SetReal(c2[i], &vr, 1, &value); break;
            case 5: if (drawn(50) == 0) fmi2Terminate(c2[i]); break;
            case 6: if (fmi2GetFMUstate(c2[i], &state2) || fmi2SetFMUstate(c2[drawn(2)], state2)) ++wrong; break;
            case 7: fmi2FreeFMUstate(c2[i], &state2); break;
            case 8:
                fmi2SerializedFMUstateSize(c2[i], state2, &size);
                if (!fmi2SerializeFMUstate(c2[i], state2, (fmi2Byte *)bytes, size)) {
                    bytes[drawn((uint32_t)size)] ^= (uint8_t)(drawn(2) << drawn(8));
                    fmi2DeSerializeFMUstate(c2[i], (fmi2Byte *)bytes, size, &state2);
                }
                break;
            case 9: fmi2GetDirectionalDerivative(c2[i], &OUT, 1, &vr, 1, &one, &read); break;
            case 10: fmi3Reset(c3[i]), time3[i] = 0.0; break;
            case 11: fmi3EnterInitializationMode(c3[i], 0, 0.0, time3[i] = drawn(3) ? 0.0 : any_value(), 0, 0.0); break;
            case 12: fmi3ExitInitializationMode(c3[i]); break;
            case 13: fmi3EnterEventMode(c3[i]); break;
            case 14: fmi3EnterStepMode(c3[i]); break;
            case 15: fmi3UpdateDiscreteStates(c3[i], &a, &b, &c, &d, &e, &read); break;
            case 16: fmi3SetFloat64(c3[i], &vr, 1, &value, 1); break;
            case 17: if (fmi3GetFMUState(c3[i], &state3[i]) || fmi3SetFMUState(c3[i], state3[i])) ++wrong; break;
            case 18: fmi3SetFMUState(c3[i], state3[1 - i]); break;
            case 19: fmi3GetDirectionalDerivative(c3[i], &OUT, 1, &vr, 1, &one, 1, &read, 1); break;
            case 20: if (drawn(50) == 0) fmi3Terminate(c3[i]); break;
            case 21: steps += !fmi3DoStep(c3[i], time3[i], step, 1, &a, &b, &c, &time3[i]); break;
            default:
                steps += !fmi2DoStep(c2[i], time2[i], step, 1);
                fmi2GetRealStatus(c2[i], fmi2LastSuccessfulTime, &time2[i]);
        }
        if (!fmi2GetReal(c2[i], &OUT, 1, &read)) sound(read);
        if (!fmi3GetFloat64(c3[i], &OUT, 1, &read, 1)) sound(read);
    }
    HOLDS(steps > calls / 100); /* else little was tried */
    fmi2FreeFMUstate(c2[0], &state2);
    for (int i = 0; i < 2; ++i) fmi3FreeFMUState(c3[i], &state3[i]), fmi3FreeInstance(c3[i]), fmi2FreeInstance(c2[i]);
}

int main(int count, char *arguments[]) {
    if (count == 4) {
        seed = (uint32_t)strtoul(arguments[2], NULL, 10);
        random_calls(strtol(arguments[3], NULL, 10));
        return wrong != 0;
    }
    instantiate2(), order2(), repeat2(), states2(), instantiate3();
    order3(false, false), order3(false, true), order3(true, false), order3(true, true);
    return wrong != 0;
}
