/* Shared by programs that replay a recording: reading its numbers and comparing with them. */
#ifndef WBC_RECORDING_H
#define WBC_RECORDING_H

#include <math.h>
#include <stdio.h>

/* Read n numbers; false: the file has fewer. */
static int read(FILE *file, double *to, int n) {
    for (int i = 0; i < n; i++)
        if (fscanf(file, "%la", to + i) != 1) return 0;
    return 1;
}

/* Update the largest difference of n numbers, relative to one plus their size. */
static void compare_numbers(const double *found, const double *wanted, int n, double *worst) {
    for (int i = 0; i < n; i++) {
        const double off = fabs(found[i] - wanted[i]) / (1.0 + fabs(wanted[i]));
        if (*worst == *worst && !(off <= *worst)) *worst = off; /* NaN stays */
    }
}

/* Replay the named file, or recording.txt; return the exit code. */
static int replay_file(int count, char **arguments, int (*replay)(FILE *)) {
    const char *path = count > 1 ? arguments[1] : "recording.txt";
    FILE *file = fopen(path, "r");
    if (!file) {
        fprintf(stderr, "%s cannot be opened\n", path);
        return 2;
    }
    const int code = replay(file);
    fclose(file);
    return code;
}

#endif
