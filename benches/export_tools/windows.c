/* Drives the FMI 3 library of a model under Windows: driver.exe LIBRARY TOKEN < poses > wrenches. */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <windows.h>

typedef void *(*make_t)(const char *, const char *, const char *, bool, bool, bool, bool,
                        const uint32_t *, size_t, void *, void *, void *);
typedef int (*enter_t)(void *, bool, double, double, bool, double);
typedef int (*leave_t)(void *);
typedef int (*numbers_t)(void *, const uint32_t *, size_t, double *, size_t);
typedef int (*step_t)(void *, double, double, bool, bool *, bool *, bool *, double *);
#define FIND(type, name) const type name = (type)(void *)GetProcAddress(library, "fmi3" #name)

int main(int count, char **given)
{
    const uint32_t pose[6] = {1, 2, 3, 4, 5, 6}, wrench[6] = {7, 8, 9, 10, 11, 12};
    HMODULE library = count == 3 ? LoadLibraryA(given[1]) : 0;
    if (!library) {
        return 2;
    }
    FIND(make_t, InstantiateCoSimulation);
    FIND(enter_t, EnterInitializationMode);
    FIND(leave_t, ExitInitializationMode);
    FIND(numbers_t, SetFloat64);
    FIND(numbers_t, GetFloat64);
    FIND(step_t, DoStep);
    void *one = InstantiateCoSimulation("one", given[2], 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
    double p[6], h[6], last;
    bool flags[3];
    if (!one || EnterInitializationMode(one, 0, 0, 0, 0, 0) || ExitInitializationMode(one)) {
        return 3;
    }
    while (scanf("%lf %lf %lf %lf %lf %lf", p, p + 1, p + 2, p + 3, p + 4, p + 5) == 6) {
        if (SetFloat64(one, pose, 6, p, 6) ||
            DoStep(one, 0, 0.001, 1, flags, flags + 1, flags + 2, &last) ||
            GetFloat64(one, wrench, 6, h, 6)) {
            return 4;
        }
        printf("%.17g %.17g %.17g %.17g %.17g %.17g\n", h[0], h[1], h[2], h[3], h[4], h[5]);
    }
    return 0;
}
