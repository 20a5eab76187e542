/* Rows that were worked out by others, for all unknowns: wbc/controllers/native_given.py. */
#include "linear.h"
#include "problem.h"

WIDE void add_given(const wbc_plan *plan, const wbc_block *block, double *J,
                           const wbc_qp *qp) {
    const int64_t n = qp->n, k = block->rows;
    const double *weight = plan->number + block->number + WEIGHTS, *matrix = weight + 3 * k;
    const double *target = matrix + k * n, *error = target + k, *damping = error + k;
    double *wanted = J + k * n;
    for (int64_t i = 0; i < k; i++) {
        double *row = J + i * n;
        for (int64_t c = 0; c < n; c++) row[c] = weight[i] * matrix[i * n + c];
        wanted[i] = weight[i] * target[i];
        qp->errors[block->first + i] = error[i];
        const double size = dot(n, row, row);
        if (size > *qp->heaviest) *qp->heaviest = size;
    }
    square(n, k, J, wanted, qp->P, n, qp->g);
    for (int64_t c = 0; c < plan->tree->nv; c++) qp->P[c * n + c] += damping[c];
}

void decide_errors(const wbc_plan *plan, const wbc_qp *qp) {
    const int64_t n = qp->n, nv = plan->tree->nv;
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++) {
        const double *number = plan->number + block->number;
        if (block->kind != GIVEN || number[DECIDED] == 0.0) continue;
        const double *row = number + WEIGHTS + 3 * block->rows, *target = row + block->rows * n;
        for (int64_t i = 0; i < block->rows; i++, row += n) {
            const double got = dot(nv, row, qp->exact) + dot(n - nv, row + nv, qp->x + nv);
            qp->errors[block->first + i] = number[DECIDED] * (got - target[i]);
        }
    }
}
