/* A tissue model in a haptic loop, from an FMI 3.0 FMU: time and position in, force out, at any rate. Header only, C99.
 *
 *   tissue_force tissue;
 *   if (!tissue_force_open(&tissue, "KB", NULL, NULL)) fail(tissue.error);     the folder of an unzipped KB_fmi3.fmu
 *   if (!tissue_force_step(&tissue, seconds, millimetres, &newtons)) fail(tissue.error);     on the device's thread
 *   tissue_force_close(&tissue);
 *
 * A model of several axes takes and gives `tissue.axes` numbers: tissue_force_step_along(&tissue, seconds, millimetres, newtons).
 *
 * The FMU samples the position by its own clock. Give each step the time that has passed on yours: a faster loop feels each
 * force held until the next sample, for a slower one positions in between are taken from a straight line. Nothing is
 * allocated, printed or waited for in a step. Units and direction are those of modelDescription.xml: for a tissue mm and N, a
 * growing position is a push, and a force of the sign `resisting_sign` resists it. Link with -ldl on Linux.
 */
#ifndef LUMBAR_TISSUE_FORCE_H
#define LUMBAR_TISSUE_FORCE_H

#include <locale.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#ifndef WIN32_LEAN_AND_MEAN
#define WIN32_LEAN_AND_MEAN
#endif
#ifndef NOMINMAX
#define NOMINMAX
#endif
#include <windows.h>
#define TISSUE_FORCE_SYSTEM "windows"
#define TISSUE_FORCE_SUFFIX ".dll"
#else
#include <dlfcn.h>
#ifdef __APPLE__
#define TISSUE_FORCE_SYSTEM "darwin"
#define TISSUE_FORCE_SUFFIX ".dylib"
#else
#define TISSUE_FORCE_SYSTEM "linux"
#define TISSUE_FORCE_SUFFIX ".so"
#endif
#endif
#if defined(__aarch64__) || defined(_M_ARM64)
#define TISSUE_FORCE_PLATFORM "aarch64-" TISSUE_FORCE_SYSTEM
#else
#define TISSUE_FORCE_PLATFORM "x86_64-" TISSUE_FORCE_SYSTEM
#endif

#define TISSUE_FORCE_VARIABLES 32
#define TISSUE_FORCE_AXES 3 /* at most */
#define TISSUE_FORCE_TEXT 4608

/* Receives warnings and errors of the FMU as plain text. */
typedef void tissue_force_log(void *context, const char *text);

typedef struct {
    char name[64];
    uint32_t reference; /* FMI's value reference */
    int size;           /* values: one, or one for every axis */
    bool is_set;        /* by tissue_force_set: a reset must not undo a lowered limit */
    double values[TISSUE_FORCE_AXES];
} tissue_force_variable;

typedef struct {
    /* What the FMU says of itself. */
    double sampling_time;       /* s */
    int axes;                   /* numbers that are a position, and a force */
    int resisting_sign;         /* of the force that resists a growing position: 1, or -1 for an inverted model */
    bool range_known;           /* of the motion that the model was fitted to, in the position's unit: */
    double lowest, highest;     /* positions */
    double speed;               /* that 99 % of the samples were below, per second */
    double lowest_Hz, highest_Hz;
    /* Yours to change: a longer gap between two steps is an error. It tells milliseconds from seconds. */
    double longest_gap; /* s */
    char error[TISSUE_FORCE_TEXT];
    /* Inside. */
    tissue_force_variable variables[TISSUE_FORCE_VARIABLES];
    int count, input, output; /* input, output: places in `variables`, -1 where not found */
    void *library, *instance;
    tissue_force_log *log;
    void *log_context;
    bool begun;
    double start, last_time, last_position[TISSUE_FORCE_AXES];
    int64_t samples;
    int (*enter_initialization)(void *, bool, double, double, bool, double);
    int (*exit_initialization)(void *);
    int (*enter_event)(void *);
    int (*update_states)(void *, bool *, bool *, bool *, bool *, bool *, double *);
    int (*enter_step)(void *);
    int (*do_step)(void *, double, double, bool, bool *, bool *, bool *, double *);
    int (*set)(void *, const uint32_t[], size_t, const double[], size_t);
    int (*get)(void *, const uint32_t[], size_t, double[], size_t);
    int (*reset)(void *);
    int (*terminate)(void *);
    void (*free_instance)(void *);
} tissue_force;

typedef void *tissue_force_instantiate(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t[],
                                       size_t, void *, void (*)(void *, int, const char *, const char *), void *);

static inline bool tissue_force_failed(tissue_force *tissue, const char *what, const char *which) {
    snprintf(tissue->error, sizeof tissue->error, "%s%s", what, which);
    return false;
}

static inline void tissue_force_logged(void *environment, int status, const char *category, const char *text) {
    const tissue_force *tissue = (const tissue_force *)environment;
    (void)status, (void)category;
    if (tissue && tissue->log && text) tissue->log(tissue->log_context, text);
}

static inline void *tissue_force_find(void *library, const char *name) {
#ifdef _WIN32
    return (void *)(size_t)GetProcAddress((HMODULE)library, name);
#else
    return dlsym(library, name);
#endif
}

/* Value of an attribute within the XML element that begins at `element`: enough for modelDescription.xml as lumbar writes it. */
static inline bool tissue_force_attribute(const char *element, const char *name, char value[], size_t size) {
    char opening[64];
    snprintf(opening, sizeof opening, " %s=\"", name);
    const char *end = element ? strchr(element, '>') : NULL;
    const char *begin = element ? strstr(element, opening) : NULL;
    if (!begin || !end || begin > end) return false;
    begin += strlen(opening);
    size_t length = strcspn(begin, "\"");
    if (length >= size) return false;
    memcpy(value, begin, length);
    value[length] = '\0';
    return true;
}

/* A number with a point, whatever decimal sign the program's locale has. */
static inline double tissue_force_number(const char *text) {
    char copy[64];
    snprintf(copy, sizeof copy, "%.63s", text);
    char *point = strchr(copy, '.');
    if (point) *point = localeconv()->decimal_point[0];
    return strtod(copy, NULL);
}

static inline bool tissue_force_told(const char *annotation, const char *name, double *value) {
    char key[64];
    snprintf(key, sizeof key, "\"%s\": ", name);
    const char *found = annotation ? strstr(annotation, key) : NULL;
    if (found) *value = tissue_force_number(found + strlen(key));
    return found != NULL;
}

/* Values of a variable: those of its dimension, where it has one. */
static inline int tissue_force_size(const char *element) {
    char text[16];
    const char *end = strchr(element, '>'), *dimension = end ? strstr(end, "<Dimension ") : NULL;
    if (!end || end[-1] == '/' || !dimension || dimension > strstr(end, "</Float64>")) return 1;
    return tissue_force_attribute(dimension, "start", text, sizeof text) ? atoi(text) : 0;
}

static inline void tissue_force_read_variables(tissue_force *tissue, const char *description) {
    char text[64];
    tissue->input = tissue->output = -1;
    for (const char *at = strstr(description, "<Float64 "); at; at = strstr(at + 1, "<Float64 ")) {
        if (tissue->count == TISSUE_FORCE_VARIABLES) break;
        tissue_force_variable *variable = &tissue->variables[tissue->count];
        if (!tissue_force_attribute(at, "name", variable->name, sizeof variable->name)) continue;
        if (!tissue_force_attribute(at, "valueReference", text, sizeof text)) continue;
        variable->reference = (uint32_t)strtoul(text, NULL, 10);
        variable->size = tissue_force_size(at);
        if (variable->size < 1 || variable->size > TISSUE_FORCE_AXES) continue;
        if (!tissue_force_attribute(at, "causality", text, sizeof text)) continue;
        if (!strcmp(text, "input") && tissue->input < 0) tissue->input = tissue->count;
        if (!strcmp(text, "output") && tissue->output < 0) tissue->output = tissue->count;
        ++tissue->count;
    }
}

/* Reads modelDescription.xml; gives what instantiation needs. */
static inline bool tissue_force_describe(tissue_force *tissue, const char *description, char identifier[], size_t size,
                                         char token[], size_t token_size) {
    const char *root = strstr(description, "<fmiModelDescription");
    const char *simulation = strstr(description, "<CoSimulation");
    char text[64];
    if (!tissue_force_attribute(root, "fmiVersion", text, sizeof text) || strncmp(text, "3.", 2) != 0) {
        return tissue_force_failed(tissue, "not an FMU of FMI 3.0: unzip <model>_fmi3.fmu", "");
    }
    if (!tissue_force_attribute(root, "instantiationToken", token, token_size) ||
        !tissue_force_attribute(simulation, "modelIdentifier", identifier, size) ||
        !tissue_force_attribute(simulation, "fixedInternalStepSize", text, sizeof text)) {
        return tissue_force_failed(tissue, "modelDescription.xml lacks token, identifier or step", "");
    }
    tissue->sampling_time = tissue_force_number(text);
    if (!(tissue->sampling_time > 0.0)) return tissue_force_failed(tissue, "fixedInternalStepSize is not above 0", "");
    tissue_force_read_variables(tissue, description);
    if (tissue->input < 0 || tissue->output < 0) return tissue_force_failed(tissue, "no input or no output is described", "");
    tissue->axes = tissue->variables[tissue->input].size;
    if (tissue->variables[tissue->output].size != tissue->axes) {
        return tissue_force_failed(tissue, "position and force are not along the same axes", "");
    }
    const char *annotation = strstr(description, "<Annotation type=\"lumbar\">");
    double sign = 1.0;
    tissue_force_told(annotation, "resisting_sign", &sign);
    tissue->resisting_sign = sign < 0.0 ? -1 : 1;
    tissue->range_known = tissue_force_told(annotation, "lowest", &tissue->lowest) &&
                          tissue_force_told(annotation, "highest", &tissue->highest) &&
                          tissue_force_told(annotation, "speed", &tissue->speed) &&
                          tissue_force_told(annotation, "lowest_Hz", &tissue->lowest_Hz) &&
                          tissue_force_told(annotation, "highest_Hz", &tissue->highest_Hz);
    return true;
}

static inline char *tissue_force_file(const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    size_t room = 1 << 14, size = 0, got;
    char *text = (char *)malloc(room);
    while (text && (got = fread(text + size, 1, room - size - 1, file)) > 0) {
        size += got;
        if (room - size - 1 == 0) {
            char *larger = (char *)realloc(text, room *= 2);
            if (!larger) free(text);
            text = larger;
        }
    }
    fclose(file);
    if (text) text[size] = '\0';
    return text;
}

static inline bool tissue_force_load(tissue_force *tissue, const char *path, void **instantiate) {
#ifdef _WIN32
    tissue->library = (void *)LoadLibraryA(path);
#else
    tissue->library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
#endif
    if (!tissue->library) return tissue_force_failed(tissue, "no library for this platform (" TISSUE_FORCE_PLATFORM "): ", path);
    struct {
        const char *name;
        void *place;
    } wanted[] = {
        {"fmi3InstantiateCoSimulation", instantiate},
        {"fmi3EnterInitializationMode", &tissue->enter_initialization},
        {"fmi3ExitInitializationMode", &tissue->exit_initialization},
        {"fmi3EnterEventMode", &tissue->enter_event},
        {"fmi3UpdateDiscreteStates", &tissue->update_states},
        {"fmi3EnterStepMode", &tissue->enter_step},
        {"fmi3DoStep", &tissue->do_step},
        {"fmi3SetFloat64", &tissue->set},
        {"fmi3GetFloat64", &tissue->get},
        {"fmi3Reset", &tissue->reset},
        {"fmi3Terminate", &tissue->terminate},
        {"fmi3FreeInstance", &tissue->free_instance},
    };
    for (size_t i = 0; i < sizeof wanted / sizeof wanted[0]; ++i) {
        void *address = tissue_force_find(tissue->library, wanted[i].name);
        if (!address) return tissue_force_failed(tissue, "the library has no ", wanted[i].name);
        /* Object pointers become function pointers by way of memory: ISO C has no cast for it. */
        memcpy(wanted[i].place, &address, sizeof address);
    }
    return true;
}

static inline bool tissue_force_initialized(tissue_force *tissue) {
    if (tissue->enter_initialization(tissue->instance, false, 0.0, 0.0, false, 0.0) > 1) {
        return tissue_force_failed(tissue, "the FMU refused to be initialized", "");
    }
    tissue->begun = false;
    tissue->samples = 0;
    return true;
}

/* Free the FMU and its library. A tissue_force that could not be opened is closed already. */
static inline void tissue_force_close(tissue_force *tissue) {
    if (tissue->instance) {
        tissue->terminate(tissue->instance);
        tissue->free_instance(tissue->instance);
    }
    if (tissue->library) {
#ifdef _WIN32
        FreeLibrary((HMODULE)tissue->library);
#else
        dlclose(tissue->library);
#endif
    }
    tissue->instance = tissue->library = NULL;
}

/* Load the FMU in a folder. `log` may be NULL: then the FMU is silent. The structure must stay where it is until it is closed. */
static inline bool tissue_force_open(tissue_force *tissue, const char *folder, tissue_force_log *log, void *log_context) {
    char path[4096], identifier[256], token[64];
    void *address = NULL;
    memset(tissue, 0, sizeof *tissue);
    tissue->longest_gap = 0.25;
    tissue->log = log;
    tissue->log_context = log_context;
    snprintf(path, sizeof path, "%s/modelDescription.xml", folder);
    char *description = tissue_force_file(path);
    if (!description) return tissue_force_failed(tissue, "cannot read ", path);
    bool described =
        tissue_force_describe(tissue, description, identifier, sizeof identifier, token, sizeof token);
    free(description);
    if (!described) return false;
    snprintf(path, sizeof path, "%s/binaries/%s/%s%s", folder, TISSUE_FORCE_PLATFORM, identifier, TISSUE_FORCE_SUFFIX);
    if (tissue_force_load(tissue, path, &address)) {
        tissue_force_instantiate *instantiate;
        memcpy(&instantiate, &address, sizeof address);
        tissue->instance = instantiate("tissue", token, NULL, false, log != NULL, true, false, NULL, 0, tissue,
                                       tissue_force_logged, NULL);
        if (!tissue->instance) tissue_force_failed(tissue, "the FMU refused its token: description and library differ", "");
    }
    if (tissue->instance && tissue_force_initialized(tissue)) return true;
    tissue_force_close(tissue);
    return false;
}

static inline tissue_force_variable *tissue_force_named(tissue_force *tissue, const char *name) {
    for (int i = 0; i < tissue->count; ++i) {
        if (!strcmp(tissue->variables[i].name, name)) return &tissue->variables[i];
    }
    return NULL;
}

/* Set a parameter that has a value for every axis, such as "force_offset" or "position_offset" in space; as the next function. */
static inline bool tissue_force_set_along(tissue_force *tissue, const char *name, const double values[]) {
    tissue_force_variable *variable = tissue_force_named(tissue, name);
    if (!variable || variable == &tissue->variables[tissue->input] || variable == &tissue->variables[tissue->output]) {
        return tissue_force_failed(tissue, "the FMU has no parameter ", name);
    }
    if (tissue->set(tissue->instance, &variable->reference, 1, values, (size_t)variable->size) > 0) {
        return tissue_force_failed(tissue, "modelDescription.xml does not allow this value of ", name);
    }
    variable->is_set = true;
    memcpy(variable->values, values, (size_t)variable->size * sizeof *values);
    return true;
}

/* Set a parameter, such as "gain", "force_limit", "force_offset" or "position_offset"; it stays through resets. One with a value for
 * every axis gets this along each. */
static inline bool tissue_force_set(tissue_force *tissue, const char *name, double value) {
    const double values[TISSUE_FORCE_AXES] = {value, value, value};
    return tissue_force_set_along(tissue, name, values);
}

/* Values of any variable, one or one for every axis. */
static inline bool tissue_force_get_along(tissue_force *tissue, const char *name, double values[]) {
    tissue_force_variable *found = tissue_force_named(tissue, name);
    if (found && tissue->get(tissue->instance, &found->reference, 1, values, (size_t)found->size) <= 1) return true;
    return tissue_force_failed(tissue, "the FMU has no variable ", name);
}

/* Value of any variable; the first of one with a value for every axis. */
static inline bool tissue_force_get(tissue_force *tissue, const char *name, double *value) {
    double values[TISSUE_FORCE_AXES];
    if (!tissue_force_get_along(tissue, name, values)) return false;
    *value = values[0];
    return true;
}

/* Begin anew, at rest, with the next step; parameters that were set stay. */
static inline bool tissue_force_reset(tissue_force *tissue) {
    if (tissue->reset(tissue->instance) > 1) return tissue_force_failed(tissue, "the FMU refused to be reset", "");
    if (!tissue_force_initialized(tissue)) return false;
    for (int i = 0; i < tissue->count; ++i) {
        tissue_force_variable *variable = &tissue->variables[i];
        if (variable->is_set && tissue->set(tissue->instance, &variable->reference, 1, variable->values, (size_t)variable->size) > 0) {
            return tissue_force_failed(tissue, "the FMU does not take again ", variable->name);
        }
    }
    return true;
}

/* One sample of the FMU: position in, in Event Mode. */
static inline bool tissue_force_sample(tissue_force *tissue, const double position[]) {
    bool event, ends, early, again, nominals, values, defined;
    double reached, next, step = tissue->sampling_time;
    const uint32_t *input = &tissue->variables[tissue->input].reference;
    void *fmu = tissue->instance;
    int worst = 0, status;
#define TISSUE_FORCE_DO(call) (status = (call), worst = status > worst ? status : worst)
    if (tissue->samples == 0) {
        TISSUE_FORCE_DO(tissue->exit_initialization(fmu)); /* into Event Mode */
    } else {
        TISSUE_FORCE_DO(tissue->do_step(fmu, (double)(tissue->samples - 1) * step, step, true, &event, &ends, &early, &reached));
        TISSUE_FORCE_DO(tissue->enter_event(fmu));
    }
    TISSUE_FORCE_DO(tissue->set(fmu, input, 1, position, (size_t)tissue->axes));
    TISSUE_FORCE_DO(tissue->update_states(fmu, &again, &ends, &nominals, &values, &defined, &next));
    TISSUE_FORCE_DO(tissue->enter_step(fmu));
#undef TISSUE_FORCE_DO
    ++tissue->samples;
    return worst <= 1 || tissue_force_failed(tissue, "the FMU refused a step", "");
}

/* Force at the position measured at this time, each along every axis, in seconds of a clock that does not go back. False leaves
 * `force` as it was: stop the device, read `error`, and call tissue_force_reset before the next step after a pause. */
static inline bool tissue_force_step_along(tissue_force *tissue, double time, const double position[], double force[]) {
    const double tolerance = 1e-3 * tissue->sampling_time; /* clocks are sums of many steps */
    const size_t axes = (size_t)tissue->axes;
    double now[TISSUE_FORCE_AXES], at[TISSUE_FORCE_AXES], *last = tissue->last_position;
    char words[96];
    bool finite = true;
    if (!isfinite(time)) return tissue_force_failed(tissue, "the time is not finite", "");
    for (size_t i = 0; i < axes; ++i) finite = finite && isfinite(position[i]);
    if (!finite && !tissue->begun) return tissue_force_failed(tissue, "the first position is not finite", "");
    memcpy(now, finite ? position : last, axes * sizeof *now); /* an encoder's hiccup: the last position stays */
    double passed = tissue->begun ? time - tissue->last_time : 0.0;
    if (passed < 0.0 || passed > tissue->longest_gap) {
        snprintf(words, sizeof words, "%g s since the last step; 0 to %g are allowed", passed, tissue->longest_gap);
        return tissue_force_failed(tissue, words, ". Are they seconds? After a pause reset first.");
    }
    if (!tissue->begun) {
        tissue->begun = true;
        tissue->start = tissue->last_time = time;
        memcpy(last, now, axes * sizeof *now);
    }
    for (;;) {
        double instant = tissue->start + (double)tissue->samples * tissue->sampling_time;
        if (instant > time + tolerance) break;
        for (size_t i = 0; i < axes; ++i) {
            at[i] = now[i];
            if (instant < time - tolerance) at[i] = last[i] + (instant - tissue->last_time) / passed * (now[i] - last[i]);
        }
        if (!tissue_force_sample(tissue, at)) return false;
    }
    tissue->last_time = time;
    memcpy(last, now, axes * sizeof *now);
    if (tissue->get(tissue->instance, &tissue->variables[tissue->output].reference, 1, force, axes) > 1) {
        return tissue_force_failed(tissue, "the FMU refused to tell its force", "");
    }
    return true;
}

/* The same of a model of one axis. */
static inline bool tissue_force_step(tissue_force *tissue, double time, double position, double *force) {
    if (tissue->axes > 1) return tissue_force_failed(tissue, "the model has several axes: take tissue_force_step_along", "");
    return tissue_force_step_along(tissue, time, &position, force);
}

#endif
