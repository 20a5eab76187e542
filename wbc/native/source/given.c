/* Rows of forces that were worked out by others, on all unknowns: ForcePart in wbc/controllers/blocks.py. */
#include "linear.h"
#include "problem.h"

#include <string.h>

WIDE void add_given(const wbc_plan *plan, const wbc_block *block, double *J, const wbc_qp *qp) {
    const int64_t n = qp->n, k = block->rows;
    const double *weight = plan->number + block->number + WEIGHTS, *matrix = weight + 3 * k;
    const double *target = matrix + k * n;
    double *wanted = J + k * n;
    const wbc_costs kept = kept_costs(plan);
    for (int64_t i = 0; i < k; i++) {
        if (plan->rows) {
            memcpy(kept.matrix + (block->first + i) * n, matrix + i * n, n * sizeof *matrix);
            kept.target[block->first + i] = target[i], kept.bias[block->first + i] = 0.0;
            continue;
        }
        double *row = J + i * n;
        for (int64_t c = 0; c < n; c++) row[c] = weight[i] * matrix[i * n + c];
        wanted[i] = weight[i] * target[i];
        const double size = dot(n, row, row);
        if (size > *qp->heaviest) *qp->heaviest = size;
    }
    if (!plan->rows) square(n, k, J, wanted, qp->P, n, qp->g);
}

void decide_errors(const wbc_plan *plan, const wbc_qp *qp) {
    const int64_t n = qp->n, nv = plan->tree->nv;
    for (const wbc_block *block = plan->block; block < plan->block + plan->blocks; block++) {
        const double *number = plan->number + block->number;
        if (block->kind != GIVEN) continue;
        const double *row = number + WEIGHTS + 3 * block->rows, *target = row + block->rows * n;
        for (int64_t i = 0; i < block->rows; i++, row += n) {
            const double got = dot(nv, row, qp->exact) + dot(n - nv, row + nv, qp->x + nv);
            qp->errors[block->first + i] = number[DECIDED] * (got - target[i]);
        }
    }
}
