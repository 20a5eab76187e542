/* Estimator and safety layer against a recorded sequence: ./replay recording.txt
 *
 * The file holds messages and cycles, with faults among them, and the results of Python, as hexadecimal numbers.
 * Exit code 0: no estimate differs by more than TOLERANCE relative to one plus its size, and all decisions and
 * commands agree to rounding; 1: they do not; 2: the file is of another robot.
 */
#include "checks.h"
#include "recording.h"
#include "sensing.h"

#include <time.h>

static const double TOLERANCE = 1e-12;
enum { SHOWN = 15, NV = WBC_JOINTS + 6, ESTIMATED = WBC_CONFIGURATION + NV + SHOWN + 1 };
enum { ARM, STAND, RUN, SOFT, DOWN, RESET };

/* Compare a message's estimate. Returns 1; 0: only one side has an estimate; -1: end of file. */
static int message(FILE *file, wbc_sensing *s, double *worst, double *seconds) {
    double head[4], joints[3][WBC_JOINTS], imu[6], expected[1], wanted[ESTIMATED], out[WBC_ESTIMATE];
    if (!read(file, head, 4) || !read(file, joints[0], 3 * WBC_JOINTS) || !read(file, imu, 6) ||
        !read(file, expected, 1) || !read(file, wanted, ESTIMATED))
        return -1;
    const int64_t heard[1] = {head[1] != 0.0};
    const wbc_sample sample = {.time = head[0],
                               .positions = joints[0],
                               .imu = imu,
                               .heard = heard,
                               .velocities = head[2] != 0.0 ? joints[1] : 0,
                               .torques = head[3] != 0.0 ? joints[2] : 0};
    const clock_t begun = clock();
    const int found = wbc_sensing_take(s, &sample, out);
    *seconds += (double)(clock() - begun) / CLOCKS_PER_SEC;
    if (found != DONE) return found == STANDING && expected[0] == 0.0;
    compare_numbers(out + WBC_AT_Q, wanted, WBC_CONFIGURATION, worst);
    compare_numbers(out + WBC_AT_V, wanted + WBC_CONFIGURATION, NV, worst);
    for (int i = 0; i < SHOWN; i++)
        compare_numbers(out + (SHOWN + 1) * i, wanted + WBC_CONFIGURATION + NV + i, 1, worst);
    compare_numbers(out + OUT_SQUARED, wanted + ESTIMATED - 1, 1, worst);
    return expected[0] == 1.0;
}

static int read_motors(FILE *file, wbc_motors *c, int *is_one) {
    double head[2];
    if (!read(file, head, 2) || !read(file, c->position, WBC_JOINTS) || !read(file, c->velocity, WBC_JOINTS) ||
        !read(file, c->torque, WBC_JOINTS) || !read(file, c->kp, WBC_JOINTS) || !read(file, c->kd, WBC_JOINTS))
        return 0;
    *is_one = head[0] != 0.0, c->enabled = head[1] != 0.0;
    return 1;
}

static int read_reading(FILE *file, wbc_reading *r, int *is_one) {
    double head[4];
    if (!read(file, head, 4) || !read(file, r->position, WBC_JOINTS) || !read(file, r->velocity, WBC_JOINTS) ||
        !read(file, r->torque, WBC_JOINTS) || !read(file, r->temperature, WBC_JOINTS) ||
        !read(file, r->quaternion, 4) || !read(file, r->rate, 3) || !read(file, r->force, 3))
        return 0;
    *is_one = head[0] != 0.0, r->sequence = (int64_t)head[1], r->time = head[2], r->stop = head[3] != 0.0;
    return 1;
}

static int granted(wbc_safety *s, int asked) {
    switch (asked) {
    case ARM:
        return wbc_safety_arm(s);
    case STAND:
        return wbc_safety_stand_up(s);
    case RUN:
        return wbc_safety_to(s, WBC_MODE_RUNNING);
    case SOFT:
        return wbc_safety_to(s, WBC_MODE_SOFT_STOP);
    case DOWN:
        return wbc_safety_to(s, WBC_MODE_DAMPING);
    default:
        return wbc_safety_reset(s);
    }
}

/* Compare a cycle. Returns 1; 0: decisions differ; -1: end of file. */
static int cycle(FILE *file, int k, wbc_safety *s, wbc_checks *checks, double *worst) {
    static wbc_reading last;
    static int has_last;
    double head[3], decided[4], borne = 0.0, torque[WBC_JOINTS];
    wbc_reading r;
    wbc_motors wanted, told;
    int comes, wants, tells, refused = -1, took = 0;
    if (!read(file, head, 3) || !read_reading(file, &r, &comes) || !read_motors(file, &wanted, &wants) ||
        !read(file, decided, 4) || !read_motors(file, &told, &tells))
        return -1;
    if (comes && (refused = wbc_checks_refused(checks, &r, head[0])) >= 0) wbc_safety_report(s, refused);
    if (head[1] >= 0.0) took = granted(s, (int)head[1]);
    if (comes && refused < 0) {
        const int knows = has_last && k % 8 == 1;
        if (knows) wbc_motor_torque(wbc_safety_admit(s, 0), last.position, last.velocity, torque);
        wbc_checks_compared(checks, &r, knows ? torque : 0, s);
        wbc_safety_measured(s, &r);
        last = r, has_last = 1;
    }
    if (head[2] >= 0.0) wbc_safety_report(s, (int)head[2]);
    const int mode = wbc_safety_judge(s);
    const wbc_motors *found = wbc_safety_admit(s, wants ? &wanted : 0);
    for (int f = 0; f < WBC_FAULTS; f++)
        if (s->borne[f] > 0.0) borne += ldexp(1.0, f);
    compare_numbers(found->position, told.position, WBC_JOINTS, worst),
        compare_numbers(found->velocity, told.velocity, WBC_JOINTS, worst);
    compare_numbers(found->torque, told.torque, WBC_JOINTS, worst),
        compare_numbers(found->kp, told.kp, WBC_JOINTS, worst);
    compare_numbers(found->kd, told.kd, WBC_JOINTS, worst);
    return refused == (int)decided[0] && took == (int)decided[1] && mode == (int)decided[2] && borne == decided[3] &&
           found->enabled == told.enabled;
}

static int replay(FILE *file) {
    static wbc_sensing sensing;
    static wbc_safety safety;
    static wbc_checks checks;
    double worst = 0.0, commanded = 0.0, seconds = 0.0;
    int samples, cycles, joints, nq, same = 1;
    if (fscanf(file, "wbc hardware recording 1 %d %d %d %d", &samples, &cycles, &joints, &nq) != 4 || samples < 1 ||
        cycles < 1 || joints != WBC_JOINTS || nq != WBC_CONFIGURATION) {
        fprintf(stderr, "not a recording of this robot\n");
        return 2;
    }
    wbc_sensing_start(&sensing), wbc_safety_start(&safety), wbc_checks_start(&checks);
    for (int k = 0; k < samples && same > 0; k++)
        if ((same = message(file, &sensing, &worst, &seconds)) == 0) fprintf(stderr, "message %d\n", k);
    for (int k = 0; k < cycles && same > 0; k++)
        if ((same = cycle(file, k, &safety, &checks, &commanded)) == 0) fprintf(stderr, "cycle %d\n", k);
    if (same < 0) {
        fprintf(stderr, "the recording ends too early\n");
        return 2;
    }
    if (same == 0) {
        fprintf(stderr, "C decides otherwise than Python there\n");
        return 1;
    }
    printf("%d messages, %.1f us each; largest difference %.1e\n%d cycles; of commands %.1e\n", samples,
           1e6 * seconds / samples, worst, cycles, commanded);
    return worst <= TOLERANCE && commanded <= TOLERANCE ? 0 : 1;
}

int main(int count, char **arguments) { return replay_file(count, arguments, replay); }
