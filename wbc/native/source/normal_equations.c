/* Normal equations of rows that couple consecutive frames, in LAPACK's lower band storage. */
#include "core.h"
#include "linear.h"

WIDE int wbc_add_normal_equations(int64_t count, int64_t nv, int64_t span, int64_t rows, const double *J,
                                  const double *off, int64_t height, double *band, double *slope) {
    const int64_t n = span * nv;
    for (int64_t k = 0; k < count; k++, J += rows * n, off += rows, band += nv * height, slope += nv) {
        add_rows(n, rows, off, J, n, slope);
        for (int64_t j = 0; j < n; j++)
            for (int64_t r = 0; r < rows; r += 4) {
                const double *row[4];
                double by[4];
                for (int i = 0; i < 4; i++) {
                    row[i] = J + (r + i < rows ? r + i : r) * n + j;
                    by[i] = r + i < rows ? *row[i] : 0.0;
                }
                add_four(n - j, by, row[0], row[1], row[2], row[3], band + j * height);
            }
    }
    return 0;
}
