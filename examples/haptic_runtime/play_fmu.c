/* Plays a file of positions through an FMI 3.0 FMU and prints time, position and force.
 *
 *   unzip KB_fmi3.fmu -d KB
 *   cc -std=c99 -O2 -I KB/sources play_fmu.c -o play_fmu -ldl      (Windows: without -ldl)
 *   ./play_fmu KB KB/resources/reference_input.csv
 *
 * The file has a head and rows "time,position", one per sample of the model. This is the loop of a haptic device: set
 * the position that was measured, read the force of the same sample, display it, step to the next.
 */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3FunctionTypes.h"

#ifdef _WIN32
#include <windows.h>
#define PLATFORM "x86_64-windows"
#define SUFFIX ".dll"
static void *open_library(const char *path) { return (void *)LoadLibraryA(path); }
static void *find_function(void *library, const char *name) {
    return (void *)(size_t)GetProcAddress((HMODULE)library, name);
}
#else
#include <dlfcn.h>
#if defined(__aarch64__)
#define PROCESSOR "aarch64"
#else
#define PROCESSOR "x86_64"
#endif
#ifdef __APPLE__
#define PLATFORM PROCESSOR "-darwin"
#define SUFFIX ".dylib"
#else
#define PLATFORM PROCESSOR "-linux"
#define SUFFIX ".so"
#endif
static void *open_library(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *find_function(void *library, const char *name) { return dlsym(library, name); }
#endif

enum { POSITION = 1, FORCE = 2 }; /* value references, as in modelDescription.xml */

static struct {
    fmi3InstantiateCoSimulationTYPE *instantiate;
    fmi3EnterInitializationModeTYPE *enter_initialization;
    fmi3ExitInitializationModeTYPE *exit_initialization;
    fmi3EnterEventModeTYPE *enter_event;
    fmi3UpdateDiscreteStatesTYPE *update_discrete_states;
    fmi3EnterStepModeTYPE *enter_step;
    fmi3DoStepTYPE *do_step;
    fmi3SetFloat64TYPE *set;
    fmi3GetFloat64TYPE *get;
    fmi3TerminateTYPE *terminate;
    fmi3FreeInstanceTYPE *free_instance;
} fmu;

static void stop(const char *what, const char *which) {
    fprintf(stderr, "play_fmu: %s%s\n", what, which);
    exit(1);
}

static void logged(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String text) {
    (void)environment, (void)status;
    fprintf(stderr, "FMU (%s): %s\n", category, text);
}

static void *function(void *library, const char *name) {
    void *found = find_function(library, name);
    if (!found) stop("the library has no ", name);
    return found;
}

static void load(const char *path) {
    void *library = open_library(path);
    if (!library) stop("cannot load ", path);
    /* Object pointers become function pointers by way of memory: ISO C has no cast for it. */
#define LOAD(member, name)                                \
    do {                                                  \
        void *address = function(library, name);          \
        memcpy(&fmu.member, &address, sizeof fmu.member); \
    } while (0)
    LOAD(instantiate, "fmi3InstantiateCoSimulation");
    LOAD(enter_initialization, "fmi3EnterInitializationMode");
    LOAD(exit_initialization, "fmi3ExitInitializationMode");
    LOAD(enter_event, "fmi3EnterEventMode");
    LOAD(update_discrete_states, "fmi3UpdateDiscreteStates");
    LOAD(enter_step, "fmi3EnterStepMode");
    LOAD(do_step, "fmi3DoStep");
    LOAD(set, "fmi3SetFloat64");
    LOAD(get, "fmi3GetFloat64");
    LOAD(terminate, "fmi3Terminate");
    LOAD(free_instance, "fmi3FreeInstance");
#undef LOAD
}

/* Value of an XML attribute: enough for modelDescription.xml as lumbar writes it, no XML parser. */
static void attribute(const char *text, const char *name, char value[], size_t size) {
    char opening[64];
    snprintf(opening, sizeof opening, "%s=\"", name);
    const char *begin = strstr(text, opening);
    const char *end = begin ? strchr(begin + strlen(opening), '"') : NULL;
    if (!end) stop("modelDescription.xml has no ", name);
    size_t length = (size_t)(end - begin) - strlen(opening);
    if (length >= size) stop("too long in modelDescription.xml: ", name);
    memcpy(value, begin + strlen(opening), length);
    value[length] = '\0';
}

static void require(fmi3Status status, const char *what) {
    if (status > fmi3Warning) stop("refused: ", what);
}

/* One tick of the haptic loop at a sample instant, in Event Mode: position in, force out. */
static double tick(fmi3Instance instance, double position) {
    const fmi3ValueReference input = POSITION, output = FORCE;
    fmi3Boolean again, ends, nominals, values, defined;
    fmi3Float64 next;
    double force;
    require(fmu.set(instance, &input, 1, &position, 1), "fmi3SetFloat64");
    require(fmu.update_discrete_states(instance, &again, &ends, &nominals, &values, &defined, &next),
            "fmi3UpdateDiscreteStates");
    require(fmu.get(instance, &output, 1, &force, 1), "fmi3GetFloat64");
    require(fmu.enter_step(instance), "fmi3EnterStepMode");
    return force;
}

static void play(fmi3Instance instance, FILE *positions, double step) {
    char row[256];
    double time, position, reached;
    fmi3Boolean event, ends, early;
    if (!fgets(row, sizeof row, positions)) stop("the file of positions is empty", "");
    puts("time,position,force");
    for (long sample = 0; fgets(row, sizeof row, positions); ++sample) {
        if (sscanf(row, "%lf,%lf", &time, &position) != 2) stop("not a row of time and position: ", row);
        if (sample > 0) {
            require(fmu.do_step(instance, (double)(sample - 1) * step, step, fmi3True, &event, &ends, &early, &reached),
                    "fmi3DoStep");
            require(fmu.enter_event(instance), "fmi3EnterEventMode");
        }
        printf("%.17g,%.17g,%.17g\n", time, position, tick(instance, position));
    }
}

int main(int count, char *arguments[]) {
    static char description[1 << 16], path[4096], identifier[256], token[64], step[64];
    if (count != 3) stop("usage: play_fmu FOLDER_OF_UNZIPPED_FMU POSITIONS.csv", "");
    snprintf(path, sizeof path, "%s/modelDescription.xml", arguments[1]);
    FILE *file = fopen(path, "rb");
    if (!file || !fread(description, 1, sizeof description - 1, file)) stop("cannot read ", path);
    fclose(file);
    attribute(description, "modelIdentifier", identifier, sizeof identifier);
    attribute(description, "instantiationToken", token, sizeof token);
    attribute(description, "fixedInternalStepSize", step, sizeof step);
    snprintf(path, sizeof path, "%s/binaries/%s/%s%s", arguments[1], PLATFORM, identifier, SUFFIX);
    load(path);
    FILE *positions = fopen(arguments[2], "rb");
    if (!positions) stop("cannot read ", arguments[2]);
    fmi3Instance instance =
        fmu.instantiate("tissue", token, NULL, fmi3False, fmi3False, fmi3True, fmi3False, NULL, 0, NULL, logged, NULL);
    if (!instance) stop("the FMU refused its token", "");
    require(fmu.enter_initialization(instance, fmi3False, 0.0, 0.0, fmi3False, 0.0), "fmi3EnterInitializationMode");
    require(fmu.exit_initialization(instance), "fmi3ExitInitializationMode"); /* the first sample: Event Mode */
    play(instance, positions, strtod(step, NULL));
    fclose(positions);
    require(fmu.terminate(instance), "fmi3Terminate");
    fmu.free_instance(instance);
    return 0;
}
