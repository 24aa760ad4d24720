/* The example of the crate ecm-poly, on the board. */
#include <stdint.h>

int32_t example_of_ecm_poly(void);

int main(void) { return (int)example_of_ecm_poly(); }
