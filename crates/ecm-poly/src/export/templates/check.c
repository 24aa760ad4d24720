/* Compares @NAME@ with the golden vectors of the model it was made from; exits 0 where all agree. */
#include "@NAME@.h"
#include "@NAME@_golden.h"

int main(void)
{
    int wrong = 0;
    for (int32_t i = 0; i < @NAME@_golden_count; i++) {
        @NAME@_real h[@M@], once[@M@], k[@NM@], far[@N@] = {0};
        far[0] = (@NAME@_real)1e9;
        wrong += @NAME@_inside(@NAME@_golden_p[i]) != 1;
        wrong += @NAME@_inside(far) != 0;
        @NAME@_value(@NAME@_golden_p[i], once);
        @NAME@_value_and_stiffness(@NAME@_golden_p[i], h, k);
        for (int32_t j = 0; j < @M@; j++) {
            const @NAME@_real e = h[j] - @NAME@_golden_h[i][j], d = once[j] - h[j];
            wrong += !(e <= @NAME@_golden_h_tolerance && e >= -@NAME@_golden_h_tolerance);
            wrong += !(d <= @NAME@_golden_h_tolerance && d >= -@NAME@_golden_h_tolerance);
        }
        for (int32_t j = 0; j < @NM@; j++) {
            const @NAME@_real e = k[j] - @NAME@_golden_k[i][j];
            wrong += !(e <= @NAME@_golden_k_tolerance && e >= -@NAME@_golden_k_tolerance);
        }
    }
    return wrong > 0;
}
