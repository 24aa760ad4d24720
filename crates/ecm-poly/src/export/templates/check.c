/* Compares @NAME@ with the golden vectors of the model it was made from; exits 0 where all agree. */
#include "@NAME@.h"
#include "@NAME@_golden.h"

/* Whether nothing is said of inputs at which the model means nothing. */
static int refused(const @NAME@_real *p)
{
    @NAME@_real h[@M@], once[@M@], k[@NM@];
    int said = @NAME@_inside(p) != 0;
    @NAME@_value(p, once);
    @NAME@_value_and_stiffness(p, h, k);
    for (int32_t j = 0; j < @M@; j++) {
        said += (once[j] == once[j]) + (h[j] == h[j]);
    }
    for (int32_t j = 0; j < @NM@; j++) {
        said += k[j] == k[j];
    }
    return said == 0;
}

@FREEPOSECHECK@@HISTORY@int main(void)
{
    int wrong = 0;
    for (int32_t i = 0; i < @N@; i++) {
        @NAME@_real p[@N@];
        for (int32_t j = 0; j < @N@; j++) {
            p[j] = @NAME@_golden_p[0][j];
        }
        if (@NAME@_golden_turns[i] > 0) {
            p[i] = (@NAME@_real)3.2;
            wrong += !refused(p);
        }
        p[i] = (@NAME@_real)0;
        p[i] /= p[i];
        wrong += !refused(p);
    }
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
            const @NAME@_real most = @NAME@_golden_k_tolerance[j % @N@];
            wrong += !(e <= most && e >= -most);
        }
@FREEPOSECALL@    }
@HISTORYCALL@    return wrong > 0;
}
