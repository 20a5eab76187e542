/* What programs that replay a recording share: its numbers, how far answers are from them, its file. */
#ifndef WBC_RECORDING_H
#define WBC_RECORDING_H

#include <math.h>
#include <stdio.h>

/* Read n numbers; false: there are fewer. */
static int read(FILE *file, double *to, int n) {
    for (int i = 0; i < n; i++)
        if (fscanf(file, "%la", to + i) != 1) return 0;
    return 1;
}

/* Let worst be the largest difference of n numbers, of one plus their size. */
static void judge(const double *found, const double *wanted, int n, double *worst) {
    for (int i = 0; i < n; i++) {
        const double off = fabs(found[i] - wanted[i]) / (1.0 + fabs(wanted[i]));
        if (*worst == *worst && !(off <= *worst)) *worst = off; /* what is no number stays */
    }
}

/* Replay the file that is named, or recording.txt; return what the program ends with. */
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
