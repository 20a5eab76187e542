/* Rows on contact forces: given by Python (ForcePart in wbc/controllers/blocks.py), or moments about a wanted
 * centre of pressure (wbc/tasks/cop.py). */
#include "linear.h"
#include "problem.h"

#include <string.h>

/* Whether a contact's forces act at a frame; those of gears, loops and bolts do not. */
static int is_at_frame(const wbc_block *contact) {
    return contact->frame >= 0 && contact->kind != LOOP && contact->kind != GEAR;
}

/* The reference point of a COP block's moments, world axes. */
static void wanted_point(const wbc_plan *plan, const wbc_block *block, const double *frames, double *point) {
    const int64_t size = FRAME_SIZE(plan->tree->nv);
    const double *own = plan->number + block->number + WEIGHTS + 3 * block->rows;
    double height = 0.0, count = 0.0;
    memcpy(point, own, 3 * sizeof *point);
    if (block->frame >= 0) { /* in the plane of the contact's frame */
        const double *frame = frames + block->frame * size;
        times3(frame + FRAME_ROTATION, own, point);
        for (int i = 0; i < 3; i++) point[i] += frame[i];
    } else if (own[3] != 0.0) { /* at the contacts' mean height */
        for (const wbc_force *f = plan->force; f < plan->force + plan->bearing; f++) {
            const wbc_block *contact = plan->block + f->block;
            if (is_at_frame(contact)) height += frames[contact->frame * size + 2], count += 1.0;
        }
        point[2] = count > 0.0 ? height / count : 0.0;
    }
}

void add_moments(const wbc_plan *plan, const wbc_block *block, const double *frames) {
    static const double world[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}, none[3] = {0.0, 0.0, 0.0};
    const int64_t n = plan->forces, size = FRAME_SIZE(plan->tree->nv);
    const double *T = block->frame < 0 ? world : frames + block->frame * size + FRAME_ROTATION;
    double point[3], *rows = plan->moments + block->other * n;
    wanted_point(plan, block, frames, point);
    memset(rows, 0, 2 * n * sizeof *rows);
    for (const wbc_force *f = plan->force; f < plan->force + plan->bearing; f++) {
        const wbc_block *contact = plan->block + f->block;
        if (!is_at_frame(contact) || (block->frame >= 0 && contact->frame != block->frame)) continue;
        const double *frame = frames + contact->frame * size, *R = frame + FRAME_ROTATION;
        /* along a contact's own rows: three forces at the frame's origin, then moments */
        const int64_t points = f->corners ? f->corners : 1, width = f->corners ? 3 : f->count;
        const double *axes = f->aligned || !f->corners ? world : R, *corner = plan->corner + f->corner;
        for (int64_t c = 0; c < points; c++) {
            double arm[3], moment[3];
            times3(R, f->corners ? corner + 3 * c : none, arm);
            for (int i = 0; i < 3; i++) arm[i] += frame[i] - point[i];
            for (int64_t k = 0; k < width; k++) {
                const double along[3] = {axes[k % 3], axes[3 + k % 3], axes[6 + k % 3]};
                const int64_t column = f->column + 3 * c + k;
                if (k < 3) cross3(arm, along, moment);
                else memcpy(moment, along, sizeof moment);
                for (int r = 0; r < 2; r++)
                    rows[r * n + column] = T[r] * moment[0] + T[3 + r] * moment[1] + T[6 + r] * moment[2];
            }
        }
    }
}

/* Write row i of a block in all unknowns (n), and return its target. */
static double read_row(const wbc_plan *plan, const wbc_block *block, int64_t i, double *row) {
    const int64_t nv = plan->tree->nv, f = plan->forces, n = nv + f;
    const double *given = plan->number + block->number + WEIGHTS + 3 * block->rows;
    if (block->kind == GIVEN) {
        memcpy(row, given + i * n, n * sizeof *row);
        return given[block->rows * n + i];
    }
    memset(row, 0, nv * sizeof *row);
    memcpy(row + nv, plan->moments + (block->other + i) * f, f * sizeof *row);
    return 0.0;
}

WIDE void add_force_rows(const wbc_plan *plan, const wbc_block *block, double *J, const wbc_qp *qp) {
    const int64_t n = qp->n, k = block->rows;
    const double *weight = plan->number + block->number + WEIGHTS;
    double *wanted = J + k * n;
    const wbc_costs stored = stored_costs(plan);
    for (int64_t i = 0; i < k; i++) {
        double *row = plan->rows ? stored.matrix + (block->first + i) * n : J + i * n;
        const double target = read_row(plan, block, i, row);
        if (plan->rows) {
            stored.target[block->first + i] = target, stored.bias[block->first + i] = 0.0;
            continue;
        }
        for (int64_t c = 0; c < n; c++) row[c] *= weight[i];
        wanted[i] = weight[i] * target;
        const double size = dot(n, row, row);
        if (size > *qp->heaviest) *qp->heaviest = size;
    }
    if (!plan->rows) add_squares(n, k, J, wanted, qp->P, n, qp->g);
}

void write_force_errors(const wbc_plan *plan, const wbc_qp *qp) {
    const int64_t n = qp->n, nv = plan->tree->nv;
    double *row = plan->scratch + plan->solver_end;
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++) {
        if (!is_of_forces(block)) continue;
        for (int64_t i = 0; i < block->rows; i++) {
            const double target = read_row(plan, block, i, row);
            const double value = dot(nv, row, qp->exact) + dot(n - nv, row + nv, qp->x + nv);
            qp->errors[block->first + i] = plan->unit * (value - target);
        }
    }
}
