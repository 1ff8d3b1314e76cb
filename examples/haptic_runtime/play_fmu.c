/* Plays a file of times and positions through an FMI 3.0 FMU and prints time, position and force.
 *
 *   unzip KB_fmi3.fmu -d KB
 *   cc -std=c99 -O2 play_fmu.c -o play_fmu -ldl -lm             (Windows: without -ldl and -lm)
 *   ./play_fmu KB KB/resources/reference_input.csv
 *   ./play_fmu KB recording.csv gain=0.5 force_limit=5           parameters of the FMU
 *
 * The file has a head and rows "time,position", times in seconds at any rate; positions of several axes with spaces between. `main` below is the loop of a haptic device, with
 * a file in place of the device.
 */
#include "tissue_force.h"

static int stop(const char *what, const char *which) {
    fprintf(stderr, "play_fmu: %s%s\n", what, which);
    return 1;
}

static void logged(void *context, const char *text) {
    (void)context;
    fprintf(stderr, "FMU: %s\n", text);
}

static int play(tissue_force *tissue, FILE *positions) {
    char row[256];
    double time, position[TISSUE_FORCE_AXES], force[TISSUE_FORCE_AXES];
    if (!fgets(row, sizeof row, positions)) return stop("the file of positions is empty", "");
    puts("time,position,force");
    while (fgets(row, sizeof row, positions)) {
        if (sscanf(row, "%lf,%lf %lf %lf", &time, position, position + 1, position + 2) != 1 + tissue->axes) {
            return stop("not a row of time and position: ", row);
        }
        if (!tissue_force_step_along(tissue, time, position, force)) return stop(tissue->error, "");
        printf("%.17g", time);
        for (int i = 0; i < tissue->axes; ++i) printf("%c%.17g", i ? ' ' : ',', position[i]);
        for (int i = 0; i < tissue->axes; ++i) printf("%c%.17g", i ? ' ' : ',', force[i]);
        putchar('\n');
    }
    return 0;
}

int main(int count, char *arguments[]) {
    tissue_force tissue;
    if (count < 3) return stop("usage: play_fmu FOLDER_OF_UNZIPPED_FMU POSITIONS.csv [PARAMETER=VALUE ...]", "");
    if (!tissue_force_open(&tissue, arguments[1], logged, NULL)) return stop(tissue.error, "");
    for (int i = 3; i < count; ++i) {
        char *value = strchr(arguments[i], '=');
        if (!value) return stop("not PARAMETER=VALUE: ", arguments[i]);
        *value++ = '\0';
        if (!tissue_force_set(&tissue, arguments[i], strtod(value, NULL))) return stop(tissue.error, "");
    }
    FILE *positions = fopen(arguments[2], "rb");
    if (!positions) return stop("cannot read ", arguments[2]);
    int status = play(&tissue, positions);
    fclose(positions);
    tissue_force_close(&tissue);
    return status;
}
