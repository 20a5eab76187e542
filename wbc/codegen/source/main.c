/* Ticks against a recorded sequence: ./replay recording.txt
 *
 * Of each tick the file has q, v, the targets of all tasks, and what the controller in Python
 * commanded, as hexadecimal numbers: every bit. Ends with 0 if no command differs by more than
 * TOLERANCE, of one plus its size; 1 if one does, or there is none; 2 if the file is another's.
 */
#include "controller.h"
#include "recording.h"

#include <string.h>
#include <time.h>

static const double TOLERANCE = 1e-9;
enum { LARGEST = WBC_NV > 9 ? WBC_NV : 9 };

/* Set the targets of all tasks to those of a tick; false: the file has fewer numbers. */
static int read_targets(FILE *file, wbc_controller *c) {
    double given[3][LARGEST];
    int sizes[3];
    for (int part = 0; part < WBC_TASKS; part++) {
        if (wbc_target_sizes(part, sizes) != DONE) continue;
        for (int k = 0; k < 3; k++)
            if (!read(file, given[k], sizes[k])) return 0;
        wbc_set_target(c, part, given[0], given[1], given[2]);
    }
    return 1;
}

static int replay(FILE *file) {
    static wbc_controller c;
    double q[WBC_NQ], v[WBC_NV], worst = 0.0, seconds = 0.0;
    wbc_command found, wanted;
    int ticks, nq, nv, torque;
    if (fscanf(file, "wbc recording 1 %d %d %d %d", &ticks, &nq, &nv, &torque) != 4 || ticks < 1 || nq != WBC_NQ ||
        nv != WBC_NV || torque != WBC_TORQUE) {
        fprintf(stderr, "not a recording of this controller\n");
        return 2;
    }
    wbc_start(&c);
    for (int k = 0; k < ticks; k++) {
        if (!read(file, q, nq) || !read(file, v, nv) || !read_targets(file, &c) || !read(file, wanted.velocity, nv) ||
            (torque && !read(file, wanted.torque, nv - 6))) {
            fprintf(stderr, "the recording ends in tick %d of %d\n", k, ticks);
            return 2;
        }
        const clock_t begun = clock();
        const int status = wbc_control(&c, q, v, &found);
        seconds += (double)(clock() - begun) / CLOCKS_PER_SEC;
        if (status != DONE) {
            fprintf(stderr, "tick %d: no command (%d)\n", k, status);
            return 1;
        }
        compare_numbers(found.velocity, wanted.velocity, nv, &worst);
        if (torque) compare_numbers(found.torque, wanted.torque, nv - 6, &worst);
    }
    printf("%d ticks, %.1f us each; largest difference %.1e\n", ticks, 1e6 * seconds / ticks, worst);
    return worst <= TOLERANCE ? 0 : 1;
}

int main(int count, char **arguments) { return replay_file(count, arguments, replay); }
