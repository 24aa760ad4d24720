/* Compares a with the golden vectors of the model it was made from; exits 0 where all agree. */
#include "a.h"
#include "a_golden.h"

/* Whether nothing is said of inputs at which the model means nothing. */
static int refused(const a_real *p)
{
    a_real h[1], once[1], k[1];
    int said = a_inside(p) != 0;
    a_value(p, once);
    a_value_and_stiffness(p, h, k);
    for (int32_t j = 0; j < 1; j++) {
        said += (once[j] == once[j]) + (h[j] == h[j]);
    }
    for (int32_t j = 0; j < 1; j++) {
        said += k[j] == k[j];
    }
    return said == 0;
}

int main(void)
{
    int wrong = 0;
    for (int32_t i = 0; i < 1; i++) {
        a_real p[1];
        for (int32_t j = 0; j < 1; j++) {
            p[j] = a_golden_p[0][j];
        }
        if (a_golden_turns[i] > 0) {
            p[i] = (a_real)3.2;
            wrong += !refused(p);
        }
        p[i] = (a_real)0;
        p[i] /= p[i];
        wrong += !refused(p);
    }
    for (int32_t i = 0; i < a_golden_count; i++) {
        a_real h[1], once[1], k[1], far[1] = {0};
        far[0] = (a_real)1e9;
        wrong += a_inside(a_golden_p[i]) != 1;
        wrong += a_inside(far) != 0;
        a_value(a_golden_p[i], once);
        a_value_and_stiffness(a_golden_p[i], h, k);
        for (int32_t j = 0; j < 1; j++) {
            const a_real e = h[j] - a_golden_h[i][j], d = once[j] - h[j];
            wrong += !(e <= a_golden_h_tolerance && e >= -a_golden_h_tolerance);
            wrong += !(d <= a_golden_h_tolerance && d >= -a_golden_h_tolerance);
        }
        for (int32_t j = 0; j < 1; j++) {
            const a_real e = k[j] - a_golden_k[i][j];
            wrong += !(e <= a_golden_k_tolerance && e >= -a_golden_k_tolerance);
        }
    }
    return wrong > 0;
}
